"""The localizers a config can name; each class takes its settings, a map and a generator."""

from followerd.registry import Registry

LOCALIZERS = Registry(
    "followerd.localizers",
    {
        "scan_histogram": "followerd.localizers.scan_histogram:ScanHistogram",
        "likelihood_field": "followerd.localizers.likelihood_field:LikelihoodField",
        "line_ekf": "followerd.localizers.line_ekf:LineLocalizer",
    },
)

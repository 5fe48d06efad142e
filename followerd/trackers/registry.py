"""The trackers a config can name; each class takes its settings and a random generator."""

from followerd.registry import Registry

TRACKERS = Registry(
    "followerd.trackers",
    {
        "head": "followerd.trackers.head:HeadTracker",
        "hpf": "followerd.trackers.hpf:Hpf",
        "legs": "followerd.trackers.legs:Legs",
        "ofkf": "followerd.trackers.ofkf:Ofkf",
        "stream_field": "followerd.trackers.stream_field:StreamFieldTracker",
        "patches": "followerd.trackers.patches:Patches",
    },
)

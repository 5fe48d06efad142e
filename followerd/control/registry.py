"""The follow laws a config can name; each class takes its settings."""

from followerd.registry import Registry

CONTROLLERS = Registry(
    "followerd.controllers",
    {
        "distance_pd": "followerd.control.distance_pd:DistancePd",
        "fuzzy_gears": "followerd.control.fuzzy_gears:FuzzyGears",
        "heading_overwrite": "followerd.control.heading_overwrite:HeadingOverwrite",
        "image_centering": "followerd.control.image_centering:ImageCentering",
        "stream_field": "followerd.control.stream_follow:StreamFollow",
    },
)

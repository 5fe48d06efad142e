"""The follow laws a config can name; each class takes its settings."""

from followerd.registry import Registry

CONTROLLERS = Registry(
    "followerd.controllers",
    {
        "image_centering": "followerd.control.image_centering:ImageCentering",
        "fuzzy_gears": "followerd.control.fuzzy_gears:FuzzyGears",
    },
)

"""The follow laws a config can name; each class takes its settings."""

from followerd.registry import Registry

CONTROLLERS = Registry(
    "followerd.controllers",
    {
        "distance_pd": "followerd.control.distance_pd:DistancePd",
        "image_centering": "followerd.control.image_centering:ImageCentering",
    },
)

"""The drivers a config can name as a device's `kind`; each class says its `role`."""

from followerd.registry import Registry

DRIVERS = Registry(
    "followerd.drivers",
    {
        "p2os": "followerd.hw.p2os.driver:P2osBase",
        "lms200": "followerd.hw.lms200.driver:Lms200",
        "camera": "followerd.hw.camera.driver:CameraDriver",
        "kinect": "followerd.hw.camera.kinect:Kinect",
        "stereo": "followerd.hw.camera.stereo:StereoPair",
        "thermal": "followerd.hw.camera.thermal:ThermalCamera",
        "vcc50i": "followerd.hw.vcc50i.driver:Vcc50i",
    },
)

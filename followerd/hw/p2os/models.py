"""The robots: what their subtype says about units and dimensions.

Figures as in the parameter files of the vendor's library and the manuals; one row per subtype.
"""

from dataclasses import dataclass, replace
from math import radians

from followerd.geometry import Pose2

Disc = tuple[int, int, int]  # x mm forward, y mm left, deg
Ring = tuple[Disc | None, ...]  # index = disc number; None = not fitted


@dataclass(frozen=True, slots=True)
class Model:
    """Conversion factors of one subtype; the wire's units, see `followerd.hw.p2os.sip`."""

    distance: float  # mm per unit of XPOS, YPOS
    range: float  # mm per unit of a sonar range
    difference: float  # rad/s per mm/s of (right - left) / 2; 1 / half track
    radius: int  # mm, swept when turning on the spot
    width: int  # mm
    front: int  # mm from the axle's middle to the front edge
    rear: int  # mm
    speed_max: int  # mm/s, absolute
    turn_max: int  # deg/s, absolute
    discs: int  # sonar discs
    ring: Ring = ()  # where they sit; empty = not known
    velocity: float = 1.0  # mm/s per unit of LVEL, RVEL
    angle_units: int = 4096  # per turn
    vel2_step: int = 20  # mm/s per unit of VEL2
    has_flags: bool = True  # False: an early P2OS, whose FLAGS are something else

    @property
    def half_track(self) -> float:
        """Half the effective distance between the wheels, m."""
        return 0.001 / self.difference

    def base_from_disc(self, disc: int) -> Pose2 | None:
        """Where a sonar disc sits and looks; None when that is not known."""
        place = self.ring[disc] if disc < len(self.ring) else None
        if place is None:
            return None
        x, y, angle = place
        return Pose2(x / 1000, y / 1000, radians(angle))


_DX_RING: Ring = (
    *((69, 136, 90), (114, 119, 50), (148, 78, 30), (166, 27, 10)),
    *((166, -27, -10), (148, -78, -30), (114, -119, -50), (69, -136, -90)),
    *((-157, -136, -90), (-203, -119, -130), (-237, -78, -150), (-255, -27, -170)),
    *((-255, 27, 170), (-237, 78, 150), (-203, 119, 130), (-157, 136, 90)),
)
_AT_RING: Ring = (
    *((147, 136, 90), (193, 119, 50), (227, 79, 30), (245, 27, 10)),
    *((245, -27, -10), (227, -79, -30), (193, -119, -50), (147, -136, -90)),
    *((-144, -136, -90), (-189, -119, -130), (-223, -79, -150), (-241, -27, -170)),
    *((-241, 27, 170), (-223, 79, 150), (-189, 119, 130), (-144, 136, 90)),
)
_PEOPLEBOT_RINGS: Ring = (
    *_DX_RING,
    *((-20, 136, 90), (24, 119, 50), (58, 78, 30), (77, 27, 10)),
    *((77, -27, -10), (58, -78, -30), (24, -119, -50), (-20, -136, -90)),
    *((-191, -136, -90), (-237, -119, -130), (-271, -78, -150), (-290, -27, -170)),
    *((-290, 27, 170), (-271, 78, 150), (-237, 119, 130), (-191, 136, 90)),
)
_AMIGO_RING: Ring = (
    *((70, 100, 90), (125, 75, 41), (144, 30, 15), (144, -30, -15)),
    *((120, -75, -41), (70, -100, -90), (-146, -58, -145), (-146, 58, 145)),
)
_PATROLBOT_RING: Ring = (
    *((83, 229, 90), (169, 202, 55), (232, 134, 30), (263, 46, 10)),
    *((263, -46, -10), (232, -134, -30), (169, -202, -55), (83, -229, -90)),
    *((-83, -229, -90), (-169, -202, -125), (-232, -134, -150), (-263, -46, -170)),
    *((-263, 46, 170), (-232, 134, 150), (-169, 202, 125), (-83, 229, 90)),
)
_POWERBOT_RINGS: Ring = (
    *((152, 278, 90), (200, 267, 65), (241, 238, 45), (274, 200, 35)),
    *((300, 153, 25), (320, 96, 15), (332, 33, 5), None),
    *((332, -33, -5), (320, -96, -15), (300, -153, -25), (274, -200, -35)),
    *((241, -238, -45), (200, -267, -65), (152, -278, -90), None),
    *((-298, -278, -90), (-347, -267, -115), (-388, -238, -135), (-420, -200, -145)),
    *((-447, -153, -155), (-467, -96, -165), (-478, -33, -175), None),
    *((-478, 33, 175), (-467, 96, 165), (-447, 153, 155), (-420, 200, 145)),
    *((-388, 238, 135), (-347, 267, 115), (-298, 278, 90), None),
)
_PIONEER_1_RING: Ring = (
    *((100, 100, 90), (120, 80, 30), (130, 40, 15), (130, 0, 0)),
    *((130, -40, -15), (120, -80, -30), (100, -100, -90)),
)

_P3DX = Model(0.485, 1, 0.0056, 250, 425, 210, 301, 2200, 500, 16, _DX_RING)
_P2DX = replace(_P3DX, distance=0.84, range=0.268, has_flags=False)
_P3AT = Model(0.465, 1, 0.0034, 500, 505, 313, 313, 1200, 300, 16, _AT_RING)
_P2AT = replace(_P3AT, distance=1.32, range=0.268, has_flags=False)
_PEOPLEBOT = Model(0.485, 1, 0.006, 340, 425, 210, 303, 2200, 500, 32, _PEOPLEBOT_RINGS)
_P2PB = replace(_PEOPLEBOT, radius=300, range=0.268, discs=24, ring=(), has_flags=False)
_AMIGO = Model(0.5083, 1, 0.011, 180, 279, 160, 170, 1000, 300, 8)
_POWERBOT = Model(0.5813, 1, 0.00373, 550, 680, 369, 542, 2000, 360, 32, _POWERBOT_RINGS)
_PATROLBOT = Model(1.0, 1, 0.0056, 250, 425, 255, 255, 2200, 500, 16)
_PIONEER_1 = Model(
    *(0.05066, 0.1734, 0.00333, 220, 400, 250, 250, 400, 100, 7, _PIONEER_1_RING),
    velocity=2.5332,
    angle_units=1024,
    vel2_step=4,
    has_flags=False,
)

MODELS = {
    "p2dx": _P2DX,
    "p2de": replace(_P2DX, distance=0.969),
    "p2ce": replace(_P2DX, distance=0.826, difference=0.0057, ring=()),
    "p2at": _P2AT,
    "p2it": replace(_P2AT, distance=1.136, difference=0.0032),
    "p2d8": replace(_P3DX, ring=()),
    "p2d8+": _P3DX,
    "p2at8": replace(_P3AT, distance=1.32, ring=()),
    "p2at8+": replace(_P3AT, ring=()),
    "p3dx": _P3DX,
    "p3dx-sh": replace(_P3DX, distance=1.0),
    "p3at": _P3AT,
    "p3at-sh": replace(_P3AT, distance=1.0),
    "p3atiw-sh": replace(_P3AT, distance=1.0, width=490),
    "perfpb": _PEOPLEBOT,
    "perfpb+": _PEOPLEBOT,
    "peoplebot-sh": replace(_PEOPLEBOT, distance=1.0),
    "p2pb": replace(_P2PB, distance=0.424, difference=0.0056),
    "p2pp": _P2PB,
    "amigo": replace(_AMIGO, velocity=0.6154),
    "amigo-sh": replace(_AMIGO, distance=1.0, ring=_AMIGO_RING),
    "powerbot": _POWERBOT,
    "powerbot-sh": replace(_POWERBOT, distance=1.0),
    "patrolbot-sh": replace(_PATROLBOT, ring=_PATROLBOT_RING),
    "researchpb": _PATROLBOT,
    "pion1m": _PIONEER_1,
    "pionat": replace(_PIONEER_1, distance=0.07, radius=330, speed_max=500),
}


def find(subtype: str) -> Model | None:
    """The model of a subtype, upper or lower case; None when it is not known."""
    return MODELS.get(subtype.lower())

"""What no base reports: the gate behind the checksum, which one damaged packet in 65536 passes."""

from math import radians

from followerd.hw.p2os.models import Model
from followerd.hw.p2os.sip import Sip, Tail

ABSURD = 2  # × the robot's top speed: no wheel turns so fast
TURN_ABSURD = 2
VOLTS_MAX = 600  # dV
RANGE_MAX = 15.0  # m, of a sonar
CHARGE_STATES = range(-1, 5)


def is_plausible(sip: Sip, model: Model) -> bool:
    """Whether a robot of this model can say so."""
    fastest = max(abs(sip.left), abs(sip.right)) * model.velocity
    turn = abs(sip.right - sip.left) / 2 * model.velocity * model.difference
    return (
        fastest <= ABSURD * model.speed_max
        and turn <= TURN_ABSURD * radians(model.turn_max)
        and abs(sip.rotation_x10) <= 10 * TURN_ABSURD * model.turn_max
        and all(
            disc < max(model.discs, 16) and distance * model.range <= 1000 * RANGE_MAX
            for disc, distance in sip.sonar
        )
        and (sip.tail < Tail.BATTERY_X10 or sip.battery_x10 <= VOLTS_MAX)
        and sip.charge_state in CHARGE_STATES
        and sip.state_of_charge <= 100
    )

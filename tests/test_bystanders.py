"""Who is known to be somebody else, and who is not."""

import numpy as np

from followerd.estimation.bystanders import Bystanders, BystanderSettings
from followerd.geometry import Array

DT = 0.1  # s
LEGS = np.array([[0.0, 0.1], [0.0, -0.1]])  # m, about somebody's middle


def walked(known: Bystanders, person: Array, other: Array) -> Array:
    """Trust in the legs of who walks to `other` (N, 2), while the person stands."""
    trust: Array = np.ones(2)
    for k in range(len(other)):
        legs = np.concatenate([person + LEGS, other[k] + LEGS])
        trust = known.step(legs, person, k * DT)
        known.learn(legs, person)
    return trust


def test_who_was_elsewhere_stays_somebody_else_before_the_person() -> None:
    known, person = Bystanders(BystanderSettings()), np.array([3.0, 0.0])
    way = np.column_stack([3.0 - 0.5 * np.ones(25), np.linspace(2.0, 0.0, 25)])
    trust = walked(known, person, way)
    assert (trust[:2] == 1.0).all()
    assert (trust[2:] < 0.1).all()


def test_what_flickers_up_and_is_gone_takes_no_leg_of_the_persons() -> None:
    known, person = Bystanders(BystanderSettings()), np.array([3.0, 0.0])
    for k, x in enumerate((4.4, 4.1, 3.8)):
        ghost = np.array([[x, 0.0]])
        known.step(np.concatenate([person + LEGS, ghost]), person, k * DT)
        known.learn(np.concatenate([person + LEGS, ghost]), person)
    # the person turns back: a leg is nearer to where the ghost would be than to who is expected
    for k in range(3, 12):
        legs = np.array([[3.1, 0.0], [3.1 + 0.05 * (k - 3), 0.0]])
        trust = known.step(legs, np.array([2.9, 0.0]), k * DT)
        known.learn(legs, person)
        assert (trust == 1.0).all()


def test_nobody_runs_away_with_a_guess() -> None:
    settings = BystanderSettings()
    known, person = Bystanders(settings), np.array([0.0, 0.0])
    for k in range(8):
        legs = np.array([[2.0 - 0.039 * k, 0.0]])
        known.step(legs, person, k * 0.01)
        known.learn(legs, person)
    assert all(np.hypot(*one.velocity) <= settings.fastest_mps + 1e-9 for one in known.known)

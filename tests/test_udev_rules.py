"""The shipped udev rules are well-formed, once filled in too, and name what the docs name."""

import re
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
RULES = (ROOT / "systemd" / "60-followerd.rules").read_text()
TERM = re.compile(r'([A-Z]+)(?:\{([A-Za-z0-9_]+)\})?(==|!=|\+=|:=|=)"([^"]*)"')
MATCHES = {"ACTION", "SUBSYSTEM", "SUBSYSTEMS", "KERNEL", "DRIVER", "ENV"}
ASSIGNED = {"GOTO", "LABEL", "ATTR", "ENV", "GROUP", "MODE", "TAG", "SYMLINK", "IMPORT"}

Term = tuple[str, str, str, str]  # key, attribute, operator, value


def terms(rule: str) -> list[Term]:
    """A rule's terms; fails where udev would not understand it."""
    found = [TERM.fullmatch(part.strip()) for part in rule.split(",")]
    assert all(found), f"not understood: {rule}"
    return [(m[1], m[2] or "", m[3], m[4]) for m in found if m]


def rules(text: str) -> list[list[Term]]:
    lines = (line.strip() for line in text.splitlines())
    return [terms(line) for line in lines if line and not line.startswith("#")]


FILLED_IN = rules(re.sub(r"^#(?=ENV)", "", RULES, flags=re.MULTILINE))


@pytest.mark.parametrize("rule", FILLED_IN)
def test_every_rule_tests_what_can_be_tested_and_sets_what_can_be_set(rule: list[Term]) -> None:
    for key, _, operator, _ in rule:
        assert key in (MATCHES if operator in ("==", "!=") else ASSIGNED)


def test_every_jump_leads_forward_to_a_label() -> None:
    labels = {v: n for n, rule in enumerate(FILLED_IN) for k, _, _, v in rule if k == "LABEL"}
    jumps = [(n, v) for n, rule in enumerate(FILLED_IN) for k, _, _, v in rule if k == "GOTO"]
    assert jumps
    assert all(labels[target] > line for line, target in jumps)


def test_as_shipped_nothing_is_named_for_that_is_each_robots_own() -> None:
    assert not [t for rule in rules(RULES) for t in rule if t[0] == "SYMLINK"]


def test_filled_in_each_device_has_a_name_by_number_by_socket_and_by_port() -> None:
    named = {
        (attribute, value)
        for rule in FILLED_IN
        for (_, attribute, _, _), (key, _, operator, value) in pairwise(rule)
        if key == "SYMLINK" and operator == "+="
    }
    assert {v for _, v in named} == {"robot", "laser", "ptz"}
    assert {a for a, _ in named} == {"ID_SERIAL_SHORT", "ID_PATH", "ID_USB_INTERFACE_NUM"}
    page = (ROOT / "docs" / "serial.md").read_text()
    assert all(f"/dev/{name}" in page for _, name in named)


def test_ports_get_low_latency_a_group_and_peace_from_modem_manager() -> None:
    flat = {term for rule in rules(RULES) for term in rule}
    assert ("ATTR", "latency_timer", "=", "1") in flat
    assert ("GROUP", "", "=", "dialout") in flat
    assert ("TAG", "", "+=", "uaccess") in flat
    assert ("ENV", "ID_MM_DEVICE_IGNORE", "=", "1") in flat


def test_a_rule_udev_would_not_understand_is_seen() -> None:
    with pytest.raises(AssertionError, match="not understood"):
        terms('ENV{ID_PATH}="x" SYMLINK+="robot"')

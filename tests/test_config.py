"""The config file: every fault at once with its place; what ships is valid."""

from pathlib import Path

import pytest

from followerd import app
from followerd.config import load, schema
from followerd.errors import ConfigError
from followerd.resources import shipped

SHIPPED = sorted(path.stem for path in shipped().glob("*.yaml"))

GOOD = """\
base: {kind: p2os, link: /dev/ttyUSB0}
laser: {kind: lms200, link: /dev/ttyUSB1, baud: 38400, resolution_deg: 1}
camera: {kind: camera, link: /dev/video0, width: 320, height: 240, rate_hz: 30}
tracker: {kind: hpf}
controller: {kind: image_centering}
"""


@pytest.fixture
def write(tmp_path: Path) -> Path:
    return tmp_path / "robot.yaml"


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_config_is_valid(name: str) -> None:
    assert load(name).tracker.kind in name


def test_a_robot_config_never_arms_by_itself_unless_it_says_so(write: Path) -> None:
    write.write_text(GOOD)
    assert load(write).operator == "manual"
    assert load("hpf").operator == "manual"


@pytest.mark.parametrize(
    ("wrong", "right", "complaint"),
    [
        ("kind: p2os", "kind: p2oz", "1:8: base.kind: input should be 'p2os' (got 'p2oz')"),
        ("baud: 38400", "baud: 38401", "2:43: laser.baud: input should be 9600, 19200, 38400"),
        ("rate_hz: 30", "rate_hz: 0", "3:68: camera.rate_hz: input should be greater than 0"),
        ("rate_hz: 30", "rate: 30", "3:68: camera.rate: unknown key; did you mean rate_hz?"),
        ("{kind: hpf}", "{kind: hpf, profil: x}", "unknown key; did you mean profile?"),
        ("resolution_deg: 1", "resolution_deg: 0.25", "an LMS200 has no field_deg 180"),
        ("tracker: {kind: hpf}\n", "", "1:1: tracker: is required"),
    ],
)
def test_a_fault_names_its_place_and_the_remedy(
    write: Path, wrong: str, right: str, complaint: str
) -> None:
    write.write_text(GOOD.replace(wrong, right))
    with pytest.raises(ConfigError) as caught:
        load(write)
    assert any(complaint in problem for problem in caught.value.problems), caught.value.problems


def test_several_faults_are_all_named_at_once(write: Path) -> None:
    write.write_text(GOOD.replace("p2os", "p2oz").replace("rate_hz: 30", "rate_hz: -3") + "x: 1\n")
    with pytest.raises(ConfigError) as caught:
        load(write)
    assert len(caught.value.problems) == 3
    assert all(problem.startswith(f"{write}:") for problem in caught.value.problems)


def test_a_missing_file_and_an_unknown_name_are_told_apart() -> None:
    with pytest.raises(ConfigError, match=r"none\.yaml: no such file"):
        load("none.yaml")
    with pytest.raises(ConfigError, match="nor a shipped config"):
        load("none")


def test_a_device_that_cannot_be_a_link_is_refused(write: Path) -> None:
    write.write_text(GOOD.replace("/dev/ttyUSB0", "'socket://robot'"))
    config = load(write)
    with pytest.raises(ConfigError, match="socket"):
        app.hardware(config)


def test_a_kind_that_belongs_elsewhere_is_refused_with_those_that_fit(write: Path) -> None:
    write.write_text(GOOD.replace("kind: camera", "kind: p2os"))
    with pytest.raises(ConfigError, match=r"camera.*'camera'.*'kinect'"):
        load(write)


def test_a_section_left_empty_is_refused(write: Path) -> None:
    write.write_text(GOOD.replace("tracker: {kind: hpf}", "tracker:"))
    with pytest.raises(ConfigError, match="tracker"):
        load(write)


def test_the_schema_lists_every_section() -> None:
    properties = schema().model_json_schema()["properties"]
    assert {"base", "laser", "camera", "tracker", "controller", "pipeline"} <= set(properties)


@pytest.mark.parametrize(
    ("baud", "resolution", "limit"),
    [(500000, 0.5, 0.20), (500000, 1, 0.20), (38400, 1, 0.26)],
)
def test_how_old_a_scan_may_be_follows_from_the_lasers_rate(
    baud: int, resolution: float, limit: float
) -> None:
    config = load("hpf-sim", {"laser.baud": baud, "laser.resolution_deg": resolution})
    settings = app.pipeline_settings(config)
    assert settings.stale_after_s["scan"] == pytest.approx(limit, abs=0.01)


@pytest.mark.parametrize(("baud", "resolution"), [(38400, 0.5), (19200, 1), (9600, 1)])
def test_a_laser_too_slow_to_drive_by_is_refused(baud: int, resolution: float) -> None:
    config = load("hpf-sim", {"laser.baud": baud, "laser.resolution_deg": resolution})
    with pytest.raises(ConfigError, match="too slow to drive by; use resolution_deg: 1"):
        app.pipeline_settings(config)


def test_a_slower_laser_makes_the_guard_reckon_with_older_scans() -> None:
    slow = load("hpf-sim", {"laser.baud": 38400, "laser.resolution_deg": 1})
    assert app.pipeline_settings(slow).guard.reaction_s > load("hpf-sim").pipeline.guard.reaction_s

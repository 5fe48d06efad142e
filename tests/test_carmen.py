"""CARMEN logs: what each line means, and what is said of broken ones."""

import gzip
from math import inf, pi
from pathlib import Path

import numpy as np
import pytest

from followerd.bench.carmen import CarmenLog
from followerd.bench.scan_logs import open_log
from followerd.errors import UsageError
from followerd.geometry import Pose2

BEAMS = " ".join(["2.5"] * 178 + ["81.91", "0"])
TAIL = "pippo"


def written(folder: Path, *lines: str) -> Path:
    path = folder / "x.log"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def flaser(stamp: float, laser: str, robot: str) -> str:
    return f"FLASER 180 {BEAMS} {laser} {robot} {stamp} {TAIL} {stamp}"


def odom(stamp: float, pose: str) -> str:
    return f"ODOM {pose} 0 0 0 {stamp} {TAIL} {stamp}"


def close(one: Pose2 | None, x: float, y: float, theta: float) -> bool:
    return one is not None and bool(np.allclose((one.x, one.y, one.theta), (x, y, theta)))


def test_a_scan_has_a_half_circle_of_beams_and_knows_what_gave_no_echo(tmp_path: Path) -> None:
    (step,) = CarmenLog(written(tmp_path, "# a log", flaser(7.5, "1 2 0", "1 2 0")))
    scan = step.scan
    assert (scan.stamp, scan.angle_min) == (7.5, -0.5 * pi)
    assert scan.angle_increment == pytest.approx(pi / 180)
    assert scan.ranges[177] == 2.5
    assert scan.ranges[178] == inf
    assert np.isnan(scan.ranges[179])


def test_odometry_is_chained_from_the_steps_between_corrections(tmp_path: Path) -> None:
    log = CarmenLog(
        written(
            tmp_path,
            odom(0.5, "0 0 0"),
            odom(1.0, "1 0 0"),
            flaser(1.0, "1 0.5 0.1", "1 0.5 0.1"),
            odom(0, "1 0.5 0.1"),
            "NEFF 15",
            odom(2.0, f"1 0.5 {0.1 + pi / 2}"),
            flaser(2.0, "1 0.6 1.6", "1 0.6 1.6"),
            # no line that says the odometry begins anew
            odom(3.0, f"1 1.6 {1.6}"),
            flaser(3.0, "1 1.7 1.6", "1 1.7 1.6"),
        )
    )
    first, second, third = log
    assert log.is_corrected
    assert close(first.ego, 1.0, 0.0, 0.0)
    assert close(first.corrected, 1.0, 0.5, 0.1)
    assert close(second.ego, 1.0, 0.0, pi / 2)
    ahead = ~Pose2(1.0, 0.6, 1.6) @ Pose2(1.0, 1.6, 1.6)
    assert third.ego is not None
    assert second.ego is not None
    moved = ~second.ego @ third.ego
    assert close(moved, ahead.x, ahead.y, ahead.theta)


def test_a_raw_log_tells_where_the_laser_sits_and_has_nothing_corrected(tmp_path: Path) -> None:
    log = CarmenLog(
        written(
            tmp_path,
            odom(1.0, "1 0 0"),
            flaser(1.0, "1.2 0 0", "1 0 0"),
            flaser(2.0, f"1 1.2 {pi / 2}", f"1 1 {pi / 2}"),
        )
    )
    assert not log.is_corrected
    first, second = log
    assert close(first.scan.base_from_laser, 0.2, 0.0, 0.0)
    assert close(second.ego, 1.0, 1.0, pi / 2)
    assert second.corrected is None


def test_poses_that_part_from_the_odometry_are_corrected_ones(tmp_path: Path) -> None:
    log = CarmenLog(
        written(
            tmp_path,
            "PARAM robot_frontlaser_offset 0.1 host 0",
            flaser(1.0, "1.1 0 0", "1 0 0"),
            flaser(2.0, "2.1 0.3 0", "2 0 0"),
        )
    )
    second = list(log)[1]
    assert close(second.ego, 2.0, 0.0, 0.0)
    assert close(second.corrected, 2.0, 0.3, 0.0)


def test_newer_laser_lines_and_centimetre_logs_are_read(tmp_path: Path) -> None:
    newer = "ROBOTLASER1 0 -1.5 3.0 0.5 20 0.01 0 3 1 20 3 2 9 9 1 2 0 1 2 0 0 0 .3 .2 0 4.5 h 4.5"
    (step,) = CarmenLog(written(tmp_path, newer))
    assert step.scan.ranges.tolist() == [1.0, inf, 3.0]
    assert (step.scan.angle_min, step.scan.stamp, step.scan.range_max) == (-1.5, 4.5, 20.0)
    wean = "L 100 0 0 125 0 0 " + " ".join(["300"] * 179 + ["8191"]) + " 2.5"
    (step,) = CarmenLog(written(tmp_path, wean, "O 100 0 0 2.6"))
    assert step.scan.ranges[0] == 3.0
    assert step.scan.ranges[-1] == inf
    assert close(step.scan.base_from_laser, 0.25, 0.0, 0.0)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("FLASER 180 1 2 3", "words where 191 are expected"),
        ("FLASER many 1 2", "many"),
        (flaser(1.0, "1 x 0", "1 2 0"), "x"),
        (flaser(1.0, "1 nan 0", "1 2 0"), "nan is no finite number"),
        ("FLASER 1 2.5 0 0 0 0 0 0 1 h 1", "at least 2"),
        ("ODOM 1 2", "broken line"),
        ("ROBOTLASER1 0 -1.5 3 0.5 20 0.01 0 3 1 2 3 0 1 2", "too few"),
        ("ROBOTLASER1 0 -1.5 3 0 20 0.01 0 2 1 2 0 1 2 0 1 2 0 0 0 0 0 0 1 h 1", "resolution"),
        ("L 1 2 3", "too few"),
    ],
)
def test_a_broken_line_is_named(tmp_path: Path, line: str, says: str) -> None:
    path = written(tmp_path, "# fine", odom(1.0, "0 0 0"), line)
    with pytest.raises(UsageError, match=says) as caught:
        CarmenLog(path)
    assert str(caught.value).startswith(f"{path}:3: ")


def test_what_is_no_log_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such file"):
        open_log(tmp_path / "none.log")
    with pytest.raises(UsageError, match="no FLASER"):
        open_log(written(tmp_path, "hello", "world"))
    binary = tmp_path / "picture.log"
    binary.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(UsageError, match="it is no text"):
        open_log(binary)
    torn = tmp_path / "torn.log.gz"
    torn.write_bytes(gzip.compress(flaser(1.0, "0 0 0", "0 0 0").encode())[:-20])
    with pytest.raises(UsageError, match="cannot be read"):
        open_log(torn)
    with pytest.raises(UsageError, match="itself where the laser sits"):
        open_log(binary, Pose2())

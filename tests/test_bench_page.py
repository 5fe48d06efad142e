"""What viewers and recordings cost is measured by turns, within one demonstration."""

from pathlib import Path

import pytest

from followerd.bench import page_demo
from followerd.bench.page import recorded
from followerd.bench.page_demo import by_turns

pytestmark = [pytest.mark.slow, pytest.mark.realtime]


async def test_pieces_with_a_recording_alternate_with_pieces_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, seconds in {"BEGINS": 1.0, "SETTLES": 0.3, "PIECES": (1.0,)}.items():
        monkeypatch.setattr(page_demo, name, seconds)
    without, with_it = await by_turns(tmp_path, 2.0, recorded, "--images", "none")
    assert len(list(tmp_path.rglob("*.mcap"))) == len(with_it.pieces) == 2
    turns = [edge for pair in zip(without.pieces, with_it.pieces, strict=True) for edge in pair]
    assert turns == sorted(turns)
    for side in (without, with_it):
        assert side.late["loop_lag"].size > 10
        assert side.percentile("loop_lag", 99) >= side.percentile("loop_lag", 50) > -1.0
        assert side.cpu_percent > 0.0

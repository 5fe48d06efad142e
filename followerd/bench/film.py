"""A film of the running daemon: the camera, the world from above, and what was decided."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from followerd.bench import overlay
from followerd.bench.top_view import TopView
from followerd.bench.video import Still, VideoWriter
from followerd.messages import Decision, Image, Measurement, Pixels, Scan, Twist
from followerd.runtime.daemon import Daemon
from followerd.sim.scenarios import Scenario
from followerd.sim.truth import Truth

LINE = 26  # px, height of a line of text
KEPT = 8  # frames that may wait for their track
GREY, WHITE = (40, 40, 40), (235, 235, 235)


class Film:
    """Watches a daemon and writes a picture for each camera frame, once it is decided upon.

    Into a film, or, where `path` ends in .png, only the last one.

    `truth` gives the world's newest truth, None as long as nobody knows it.
    """

    def __init__(
        self, path: Path, rate: float, scenario: Scenario, truth: Callable[[], Truth | None]
    ) -> None:
        self._video = Still(path) if path.suffix == ".png" else VideoWriter(path, rate)
        self._scenario = scenario
        self._truth = truth
        self._above: TopView | None = None
        self._waiting: dict[int, Image] = {}
        self._scan: Scan | None = None

    def attach(self, daemon: Daemon) -> None:
        """Look on from now on."""
        daemon.measurement_watchers.append(self.measured)
        daemon.decision_watchers.append(self.decided)

    def close(self) -> None:
        """Write the frames that still wait, and finish the file."""
        for number in sorted(self._waiting):
            self._write(self._waiting.pop(number), None)
        self._video.close()

    def measured(self, measurement: Measurement) -> None:
        """Keep the newest scan, and the frames until their tracks come."""
        if isinstance(measurement, Scan):
            self._scan = measurement
        elif isinstance(measurement, Image):
            self._waiting[measurement.id] = measurement
            if len(self._waiting) > KEPT:
                self._write(self._waiting.pop(min(self._waiting)), None)

    def decided(self, decision: Decision) -> None:
        """Write the frame that the decision's track stands on, and those skipped before it.

        A track of scans stands on no frame: it is written on those that it has overtaken.
        """
        track = decision.track
        if track is not None and track.frame_id is None:
            for number in sorted(n for n, i in self._waiting.items() if i.stamp <= track.stamp):
                self._write(self._waiting.pop(number), decision)
            return
        if track is None or track.frame_id not in self._waiting:
            return
        for number in sorted(n for n in self._waiting if n <= track.frame_id):
            self._write(self._waiting.pop(number), decision if number == track.frame_id else None)

    def _write(self, image: Image, decision: Decision | None) -> None:
        self._video.write(self.picture(image, decision))

    def picture(self, image: Image, decision: Decision | None) -> Pixels:
        """One picture (H, W, 3); without a decision, the camera and the world alone."""
        track = decision.track if decision else None
        seen = overlay.draw(image.pixels, track, f"#{image.id}")
        parts = [seen]
        truth = self._truth()
        if truth is not None:
            if self._above is None:
                self._above = TopView(self._scenario, seen.shape[0])
            parts.append(self._above.draw(truth, image.camera, self._scan, track))
        top = np.hstack(parts)
        return np.vstack([top, _caption(decision, image.stamp, top.shape[1])])


def _caption(decision: Decision | None, stamp: float, width: int) -> Pixels:
    bar = np.full((2 * LINE, width, 3), GREY, np.uint8)
    lines = [f"{stamp:7.2f} s"]
    if decision is not None:
        motion = decision.command.motion
        moves = (
            f"v {motion.v:+.2f} m/s  w {motion.omega:+.2f} rad/s"
            if isinstance(motion, Twist)
            else "stop"
        )
        lines = [
            f"{stamp:7.2f} s  {decision.mode.value}  {moves}",
            "; ".join(str(reason) for reason in decision.reasons),
        ]
    for number, line in enumerate(lines):
        at = (8, LINE * (number + 1) - 8)
        cv2.putText(bar, line, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, WHITE, 1, cv2.LINE_AA)
    return bar

"""What a run measured of itself: latencies, loop lag, modes, stops, load."""

import os
import resource
from collections import Counter, deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from time import process_time

import numpy as np

from followerd import clock
from followerd.messages import Command, Decision, Fault, Image, Measurement, Mode, Scan

LAG_PERIOD = 0.02  # s
KEPT = 100_000  # newest figures of each kind: a daemon runs for weeks

Late = tuple[float, float]  # loop time, and how late; s


@dataclass(slots=True)
class Stop:
    """One transition from moving to a full stop."""

    reason: str  # StopReason name, lower case
    device: str
    at: float  # s, loop time of the decision
    time_to_stop: float | None = None  # s, from the decision to zero velocity's last byte

    def row(self, began: float) -> dict[str, object]:
        """As the summary lists it."""
        return {
            "reason": self.reason,
            "device": self.device,
            "at_s": round(self.at - began, 3),
            "time_to_stop_s": None if self.time_to_stop is None else round(self.time_to_stop, 4),
        }


@dataclass
class Stats:
    """Counters of one run; everything is cheap to note and worked out at the end."""

    began: float  # s, loop time
    frames: int = 0
    scans: int = 0
    mode: Mode = Mode.DISARMED
    mode_since: float = 0.0
    mode_times: dict[Mode, float] = field(default_factory=dict)
    latencies: dict[str, deque[Late]] = field(default_factory=dict)  # of commands, by their cause
    lags: deque[Late] = field(default_factory=lambda: deque(maxlen=KEPT))  # of the loop
    stops: list[Stop] = field(default_factory=list)
    losses: Counter[str] = field(default_factory=Counter)  # of devices, by their names
    down: set[str] = field(default_factory=set)  # devices that are lost now
    moving: bool = False
    process_began: float = field(default_factory=process_time)

    def measured(self, measurement: Measurement) -> None:
        """Note a measurement."""
        self.frames += isinstance(measurement, Image)
        self.scans += isinstance(measurement, Scan)

    def faulted(self, fault: Fault) -> None:
        """Note that a device is lost, or back; it is tried again and again meanwhile."""
        if fault.recovered:
            self.down.discard(fault.device)
        elif fault.device not in self.down:
            self.down.add(fault.device)
            self.losses[fault.device] += 1

    def decided(self, decision: Decision) -> None:
        """Note a decision: time in modes, stops."""
        if decision.mode is not self.mode:
            self._leave_mode(decision.stamp)
            self.mode = decision.mode
        stops = decision.command.stops
        if stops and self.moving:
            # without a reason to stop, the follow law wished to stand
            for reason in [r for r in decision.command.reasons if r.full_stop][:1]:
                asked_by = reason.device or "operator"  # what no device asks for, they do
                self.stops.append(Stop(reason.stop.name.lower(), asked_by, decision.stamp))
        self.moving = not stops

    def sent(self, command: Command, stamp: float) -> None:
        """Note that a command's last byte was written."""
        if command.cause_received is not None:
            late = stamp, stamp - command.cause_received
            self.latencies.setdefault(command.cause, deque(maxlen=KEPT)).append(late)
        if command.stops and self.stops and self.stops[-1].time_to_stop is None:
            self.stops[-1].time_to_stop = stamp - self.stops[-1].at

    def finish(self, now: float) -> None:
        """Close the account."""
        self._leave_mode(now)

    async def watch_lag(self) -> None:
        """Measure for ever how late the loop wakes us; in virtual time nothing is late."""
        while not clock.is_virtual():
            due = clock.now() + LAG_PERIOD
            await clock.sleep(LAG_PERIOD)
            now = clock.now()
            self.lags.append((now, now - due))

    def _leave_mode(self, now: float) -> None:
        since = self.mode_since or self.began
        self.mode_times[self.mode] = self.mode_times.get(self.mode, 0.0) + now - since
        self.mode_since = now

    def cpu_percent(self, elapsed: float) -> float:
        """Share of one core that this process used since it was made."""
        return 100.0 * (process_time() - self.process_began) / max(elapsed, 1e-9)


def delays(late: Iterable[Late]) -> list[float]:
    """How late, without when."""
    return [seconds for _, seconds in late]


def percentiles(values: Collection[float], *names: str) -> dict[str, float | None]:
    """Percentiles in ms: names such as p50, p99, max; None where nothing was measured."""
    if not values:
        return dict.fromkeys(names)
    ms = 1000.0 * np.fromiter(values, float, len(values))
    return {
        name: round(float(ms.max() if name == "max" else np.percentile(ms, float(name[1:]))), 3)
        for name in names
    }


def rss_mb() -> float:
    """Resident memory of this process now, MB."""
    with open(f"/proc/{os.getpid()}/statm", encoding="ascii") as statm:  # noqa: PTH123 a kernel file
        pages = int(statm.read().split()[1])
    return round(pages * resource.getpagesize() / 1e6, 1)


def summary(stats: Stats, *, virtual: bool, now: float) -> dict[str, object]:
    """The figures of a run that need no truth (DESIGN section 5)."""
    elapsed = now - stats.began
    causes = {"image": "frame_to_command", "scan": "scan_to_command"}
    return {
        "duration_s": round(elapsed, 3),
        "virtual_time": virtual,
        "mode_s": {mode.value: round(seconds, 3) for mode, seconds in stats.mode_times.items()},
        "frames": stats.frames,
        "scans": stats.scans,
        "latency_ms": {
            name: percentiles(delays(stats.latencies.get(cause, [])), "p50", "p99", "max")
            for cause, name in causes.items()
        },
        "loop_lag_ms": percentiles([] if virtual else delays(stats.lags), "p99", "max"),
        "cpu_percent": None if virtual else round(stats.cpu_percent(elapsed), 1),
        "rss_mb": rss_mb(),
        "stops": [stop.row(stats.began) for stop in stats.stops],
    }

"""The whole daemon in virtual time, and its score against the truth."""

from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

from followerd import app, clock
from followerd.bench.metrics import Figures, follow_figures
from followerd.bench.pose_scores import localization_figures
from followerd.config import SIM, Config
from followerd.messages import Decision
from followerd.runtime.daemon import Daemon
from followerd.runtime.stats import percentiles, summary
from followerd.sim import scenarios
from followerd.sim.rig import Rig
from followerd.sim.truth import Truth

Summary = dict[str, Any]


def staged(config: Config) -> Config:
    """The config as its scenario's task asks: `fixate` only turns, `watch` never arms.

    What is to be watched need not be a person, so its place in the first picture is shown.
    """
    task = scenarios.load(config.sim.scenario).task
    if task == "fixate":
        turning = config.controller.model_copy(update={"turn_only": True})
        return config.model_copy(update={"controller": turning})
    if task == "watch" and config.enrol_px is None:
        rig = app.rig(config)
        rig.world.advance(0.0)
        seen = rig.world.truth_box(app.equipment(config).camera)
        region = None if seen is None else (seen[0].x, seen[0].y, seen[0].w, seen[0].h)
        return config.model_copy(update={"operator": "watch", "enrol_px": region})
    return config


@dataclass
class Run:
    """What a run leaves behind."""

    config: Config
    daemon: Daemon
    truths: list[Truth]
    decisions: list[Decision] = field(default_factory=list)
    wall_s: float | None = None  # how long it took to compute

    def summary(self, now: float, *, virtual: bool) -> Summary:
        """The run's figures (DESIGN section 5)."""
        vision, tracker = self.daemon.vision, self.config.tracker
        times = (self.daemon.scanning or vision).step_times
        figures = summary(self.daemon.stats, virtual=virtual, now=now)
        return {
            "scenario": self.config.sim.scenario if self.truths else None,
            "tracker": "/".join(filter(None, (tracker.kind, getattr(tracker, "profile", None)))),
            "seed": self.config.seed,
            **figures,
            "dropped_frames": vision.dropped,
            "follow": self._follow(),
            "localization": self._localization(),
            "shadow": None if self.daemon.shadows is None else self.daemon.shadows.figures(),
            "tracker_ms": percentiles(times, "p50", "p99"),
            "wall_s": self.wall_s,
        }

    def _localization(self) -> dict[str, float | int | None] | None:
        section = self.config.localizer
        if section is None or not self.decisions:
            return None
        return localization_figures(self.truths if section.map == SIM else [], self.decisions)

    def _follow(self) -> Figures | None:
        if not self.truths or not self.decisions:
            return None
        began, ended = self.decisions[0].stamp, self.decisions[-1].stamp
        truths = [truth for truth in self.truths if began <= truth.stamp <= ended]
        return follow_figures(truths, self.decisions, app.equipment(self.config).camera)


def simulate(
    config: Config, duration: float, *watchers: app.Attach, world: Rig | None = None
) -> Summary:
    """Run the config in virtual time on its twins; the same seed gives the same summary."""
    return clock.run_virtual(_simulate(config, duration, watchers, world or app.rig(config)))


async def _simulate(
    config: Config, duration: float, watchers: tuple[app.Attach, ...], world: Rig
) -> Summary:
    decisions: list[Decision] = []

    def attach(daemon: Daemon) -> None:
        daemon.decision_watchers.append(decisions.append)
        for watch in watchers:
            watch(daemon)

    began = perf_counter()
    daemon = await app.virtual(config, duration, attach, world)
    run = Run(config, daemon, world.truths, decisions, round(perf_counter() - began, 3))
    return run.summary(clock.now(), virtual=True)

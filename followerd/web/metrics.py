"""What Prometheus reads; names carry their units."""

from collections.abc import Iterator
from itertools import islice

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from followerd import clock
from followerd.messages import Mode
from followerd.runtime.daemon import Daemon
from followerd.runtime.stats import delays, percentiles, rss_mb

QUANTILES = {"p50": "0.5", "p99": "0.99"}
NEWEST = 2000  # measurements that a quantile is taken of


class DaemonMetrics(Collector):
    """Read from the daemon when asked."""

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon

    def collect(self) -> Iterator[Metric]:
        """All families."""
        daemon, stats, now = self._daemon, self._daemon.stats, clock.now()
        yield _count("followerd_frames", "Images taken.", stats.frames)
        yield _count("followerd_scans", "Scans taken.", stats.scans)
        yield _count("followerd_frames_dropped", "Images never looked at.", daemon.vision.dropped)
        yield _count("followerd_stops", "Stops from motion, with a reason.", len(stats.stops))
        losses = CounterMetricFamily(
            "followerd_device_losses", "A device was lost.", labels=["device"]
        )
        for device, count in stats.losses.items():
            losses.add_metric([device], count)
        yield losses
        errors = CounterMetricFamily(
            "followerd_device_errors", "Something came broken, or not at all.", labels=["device"]
        )
        for device, count in daemon.errors().items():
            errors.add_metric([device], count)
        yield errors
        ages = GaugeMetricFamily(
            "followerd_stream_age_seconds", "Since the newest was measured.", labels=["stream"]
        )
        for name, newest in daemon.pipeline.freshness.newest.items():
            ages.add_metric([name], now - newest)
        yield ages
        yield self._modes()
        yield from self._latencies()
        track = None if daemon.decision is None else daemon.decision.track
        if track is not None and track.range is not None:
            yield _gauge("followerd_target_range_meters", "To the person.", track.range)
        if track is not None:
            yield _gauge("followerd_target_confidence_ratio", "That it is they.", track.confidence)
        yield _gauge("followerd_resident_memory_bytes", "Of this process.", rss_mb() * 1e6)

    def _modes(self) -> Metric:
        decision = self._daemon.decision
        modes = GaugeMetricFamily("followerd_mode", "1 for the mode it is in.", labels=["mode"])
        for mode in Mode:
            modes.add_metric([mode.value], float(decision is not None and decision.mode is mode))
        return modes

    def _latencies(self) -> Iterator[Metric]:
        stats = self._daemon.stats
        family = GaugeMetricFamily(
            "followerd_latency_seconds",
            "From a measurement in memory to the command's last byte.",
            labels=["cause", "quantile"],
        )
        for cause, values in stats.latencies.items():
            newest = delays(islice(reversed(values), NEWEST))
            for name, value in percentiles(newest, *QUANTILES).items():
                if value is not None:
                    family.add_metric([cause, QUANTILES[name]], value / 1000.0)
        yield family
        lag = percentiles(delays(islice(reversed(stats.lags), NEWEST)), "p99")["p99"]
        if lag is not None:
            yield _gauge("followerd_loop_lag_p99_seconds", "The loop was late.", lag / 1000.0)


def registry(daemon: Daemon) -> CollectorRegistry:
    """A registry of its own."""
    own = CollectorRegistry()
    own.register(DaemonMetrics(daemon))
    return own


def _count(name: str, text: str, value: float) -> Metric:
    return CounterMetricFamily(name, text, value=value)


def _gauge(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(name, text, value=value)

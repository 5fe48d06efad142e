"""A live view of the run in the terminal; it only looks."""

from types import TracebackType

from rich.console import Console, RenderableType
from rich.live import Live
from rich.table import Table

from followerd.messages import Decision, Twist
from followerd.runtime.daemon import Daemon

REFRESH = 5  # a second


class Display:
    """Shows mode, person, command and reasons while it is entered; nothing when headless."""

    def __init__(self, *, headless: bool) -> None:
        console = Console()
        self._decision: Decision | None = None
        self._page = ""
        self._live = (
            None
            if headless or not console.is_terminal
            else Live(console=console, refresh_per_second=REFRESH, get_renderable=self._table)
        )

    @property
    def is_shown(self) -> bool:
        """Whether there is something to see."""
        return self._live is not None

    def attach(self, daemon: Daemon) -> None:
        """Look at a daemon's decisions."""
        if self._live is not None:
            daemon.decision_watchers.append(self._look)

    def tell(self, address: str) -> None:
        """Show where the operator's page is."""
        self._page = address
        if self._live is None:
            print(f"page: {address}", flush=True)

    def _look(self, decision: Decision) -> None:
        self._decision = decision

    def _table(self) -> RenderableType:
        table = Table.grid(padding=(0, 2))
        decision = self._decision
        if self._page:
            table.add_row("page", f"[bold]{self._page}[/]")
        if decision is None:
            table.add_row("[bold]starting[/]")
            return table
        track = decision.track
        table.add_row("mode", f"[bold]{decision.mode.value}[/]")
        if track is None:
            table.add_row("person", "nobody enrolled")
        else:
            distance = "unknown" if track.range is None else f"{track.range:.2f} m"
            table.add_row("person", f"{track.phase.value}, {track.confidence:.0%} sure")
            table.add_row("distance", distance)
        motion = decision.command.motion
        speed = (
            f"{motion.v:+.2f} m/s {motion.omega:+.2f} rad/s" if isinstance(motion, Twist) else ""
        )
        table.add_row("command", speed or ("stand" if motion is None else str(motion)))
        table.add_row("because", "; ".join(str(reason) for reason in decision.reasons) or "-")
        return table

    def __enter__(self) -> "Display":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()

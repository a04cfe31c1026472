"""The training's progress bar: frames, frames per second, and the task's own metrics."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

_SHOWN = ("success", "flight_energy_wh", "saving_vs_direct")


def _summary(means: dict[str, float]) -> str:
    return "  ".join(f"{name} {means[name]:.3g}" for name in _SHOWN if means.get(name) is not None)


class TrainingBar:
    """A rich progress bar with steps/s and recent episode metrics; a context manager."""

    def __init__(self, *, total: int, start: int, quiet: bool = False) -> None:
        self.console = Console(stderr=True, quiet=quiet)
        self.progress = Progress(
            TextColumn("training"), BarColumn(), TextColumn("{task.completed:,}/{task.total:,}"),
            TextColumn("{task.fields[speed]}"), TimeElapsedColumn(), TimeRemainingColumn(),
            TextColumn("{task.fields[metrics]}"), console=self.console, refresh_per_second=2,
        )  # fmt: skip
        self.task = self.progress.add_task("", total=total, completed=start, speed="", metrics="")

    def __enter__(self) -> TrainingBar:
        self.progress.start()
        return self

    def __exit__(self, *exception: Any) -> None:
        self.progress.stop()

    def update(self, frames: int, means: dict[str, float]) -> None:
        """Show ``frames`` done and the mean metrics of recent episodes."""
        speed = self.progress.tasks[0].speed
        self.progress.update(
            self.task,
            completed=frames,
            speed=f"{speed:,.0f} steps/s" if speed else "",
            metrics=_summary(means),
        )

    def imitation(self, number: int, loss: float, labels: int) -> None:
        """Report one round of imitation."""
        self.console.print(f"imitation round {number}: loss {loss:.4f} on {labels:,} labels")

    def evaluation(self, frames: int, results: dict[str, float]) -> None:
        """Report one evaluation on held-out seeds."""
        self.console.print(f"validation at {frames:,}: score {results['score']:.3f}  {_summary(results)}")

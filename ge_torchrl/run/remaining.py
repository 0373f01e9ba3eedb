"""How much longer a run takes."""

from __future__ import annotations

from ge_torchrl.artefacts.records import GenerationRecord
from ge_torchrl.config import GEConfig


def seconds_left(record: GenerationRecord, config: GEConfig, fraction_after_search: float) -> float:
    """Return the seconds that a run still takes after a generation, its limits held, as far as one can tell.

    Args:
        record: The generation; those to come are taken to last as long as those so far.
        config: How many generations are planned, and the limits.
        fraction_after_search: Share of the whole run's time that everything after the last generation takes.
    """
    elapsed, done = record.elapsed_seconds, record.generation + 1
    search = elapsed * config.generations / done
    left = search / (1 - fraction_after_search) - elapsed
    if config.max_seconds is not None:
        left = min(left, config.max_seconds - elapsed)
    if config.max_env_steps is not None and record.env_steps > 0:
        left = min(left, elapsed * (config.max_env_steps / record.env_steps - 1))
    return max(0.0, left)


def duration(seconds: float | None) -> str:
    """Return seconds as minutes and seconds, with hours where there are any; a dash where nobody knows."""
    if seconds is None:
        return "-"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"

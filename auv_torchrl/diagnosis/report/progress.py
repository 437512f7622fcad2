"""What a person sees while a diagnosis works."""

import logging

from tqdm import tqdm

log = logging.getLogger(__name__)


class ProgressBar:
    """A bar on a terminal, one line per stage elsewhere; call it with the stage and the share of the work done."""

    def __enter__(self) -> "ProgressBar":
        """Start at nothing done."""
        self._bar = tqdm(
            total=1.0, bar_format="{desc:<32} {percentage:3.0f} % {bar} {elapsed}", disable=None, leave=False
        )
        self._stage = ""
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the bar."""
        self._bar.close()

    def __call__(self, stage: str, share: float) -> None:
        """Show that ``share`` of the work, in [0, 1], is done and ``stage`` begins."""
        self._bar.n = min(max(share, self._bar.n), 1.0)  # a second look begins again, but nothing is undone
        if self._bar.disable and stage != self._stage:
            log.info("%3.0f %% %s", 100 * self._bar.n, stage)
        self._stage = stage
        self._bar.set_description_str(stage, refresh=False)
        self._bar.refresh()

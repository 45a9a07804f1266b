"""Whether the process that supervises a motion was held up, so that silence of a stream proves nothing."""

from poise.excitation.execution.options import ExecutionOptions


class HeldUp:
    """Watches the ticks of a supervisor: after a gap, messages wait unread that would prove their streams alive.

    Args:
        now: s.
        options: `held_up` is the gap, and `stale` the time after it in which streams are trusted.
    """

    def __init__(self, now: float, options: ExecutionOptions) -> None:
        self._gap, self._trust = options.held_up, options.stale
        self._ticked = self._until = now

    def tick(self, now: float) -> None:
        """Call at every tick, s."""
        if now - self._ticked > self._gap:
            self._until = now + self._trust
        self._ticked = now

    def lately(self, now: float) -> bool:
        """Messages may still wait."""
        return now < self._until

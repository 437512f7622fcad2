"""A request that cannot be answered."""


class Refusal(ValueError):
    """Says why; ``status`` is that of the answer, by default the usual one of its kind."""

    usual = 400

    def __init__(self, message: str, status: int | None = None) -> None:
        super().__init__(message)
        self.status = self.usual if status is None else status

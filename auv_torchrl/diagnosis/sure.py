"""One wording for how sure a cause is, wherever it is told."""

from auv_torchrl.diagnosis.thresholds import LIKELY, SURE


def how_sure(clause: str, probability: float) -> str:
    """A clause as a fact where it is one, else behind "probably", or "perhaps" where it may as well be untrue."""
    if probability > SURE:
        return clause
    word = "probably" if probability > LIKELY else "perhaps"
    percent = f"{100 * probability:.0f} %" if probability >= 0.01 else "below 1 %"
    return f"{word} ({percent}) {clause[:1].lower()}{clause[1:].replace('; ', ' and ')}"

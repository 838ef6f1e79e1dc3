from dataclasses import dataclass
@dataclass(frozen=True)
class Hypothesis:
    node: int
    posterior: float
    accepted: bool

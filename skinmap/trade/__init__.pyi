from skinmap.trade.front import pareto, recommend
from skinmap.trade.measuring import (
    Knob,
    Outcome,
    Point,
    TradeResult,
    TradeTask,
    cpu_seconds,
    measure,
)

__all__ = [
    "Knob",
    "Outcome",
    "Point",
    "TradeResult",
    "TradeTask",
    "cpu_seconds",
    "measure",
    "pareto",
    "recommend",
]

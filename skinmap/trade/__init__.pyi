from skinmap.trade.measuring import (
    Knob,
    Outcome,
    Point,
    TradeResult,
    TradeTask,
    cpu_seconds,
    measure,
    pareto,
    recommend,
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

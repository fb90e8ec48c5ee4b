"""Many tasks on several cores or machines: results in order, resumed after an interruption."""

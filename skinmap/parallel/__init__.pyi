from skinmap.parallel.run import each_result, run_tasks, task_rng
from skinmap.parallel.workers import ResumeStore, Workers, open_workers

__all__ = [
    "ResumeStore",
    "Workers",
    "each_result",
    "open_workers",
    "run_tasks",
    "task_rng",
]

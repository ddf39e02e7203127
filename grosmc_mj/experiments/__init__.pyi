from .catalogue import chapter_controller
from .experiment import Experiment, judge
from .many import run_many

__all__ = ["Experiment", "chapter_controller", "judge", "run_many"]

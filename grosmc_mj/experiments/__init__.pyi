from .catalogue import chapter_controller
from .experiment import Experiment
from .many import run_many

__all__ = ["Experiment", "chapter_controller", "run_many"]

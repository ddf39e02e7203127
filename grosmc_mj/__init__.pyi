from . import (
    control,
    environments,
    errors,
    films,
    loop,
    machine,
    physics,
    plants,
    simulation,
    sweep,
)
from .control.controller import Controller, custom_controller
from .control.coordinates.feedback_linearization import feedback_linearization
from .control.design import linearized_lqr, regulating_grosmc, tracking_grosmc
from .control.from_control import from_control
from .control.lqr import lqr
from .control.task import Realization, Task
from .control.uncertainty.outputs import Uncertainty
from .errors import GrosmcError
from .experiments.catalogue import chapter_controller
from .experiments.experiment import Experiment, judge
from .experiments.many import run_many
from .physics.edits import AddedMass, BodyEdit, JointEdit
from .physics.mujoco_plant import MujocoPlant
from .plants import AnalyticPlant, affine_plant
from .robots.robot import Robot
from .simulation.disturbances import (
    Disturbance,
    InputDisturbance,
    OutputDisturbance,
    Pulse,
    RateDisturbance,
)
from .simulation.simulate import simulate
from .simulation.trajectory import Trajectory, load_trajectory
from .sweep.campaign import Campaign

__version__: str

__all__ = [
    "AddedMass",
    "AnalyticPlant",
    "BodyEdit",
    "Campaign",
    "Controller",
    "Disturbance",
    "Experiment",
    "GrosmcError",
    "InputDisturbance",
    "JointEdit",
    "MujocoPlant",
    "OutputDisturbance",
    "Pulse",
    "RateDisturbance",
    "Realization",
    "Robot",
    "Task",
    "Trajectory",
    "Uncertainty",
    "affine_plant",
    "chapter_controller",
    "control",
    "custom_controller",
    "environments",
    "errors",
    "feedback_linearization",
    "films",
    "from_control",
    "judge",
    "linearized_lqr",
    "load_trajectory",
    "loop",
    "lqr",
    "machine",
    "physics",
    "plants",
    "regulating_grosmc",
    "run_many",
    "simulate",
    "simulation",
    "sweep",
    "tracking_grosmc",
]

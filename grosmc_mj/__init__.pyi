from . import environments, simulation, studies
from .experiments.catalogue import chapter_controller
from .experiments.experiment import Experiment
from .experiments.many import run_many
from .ground import errors
from .ground.errors import GrosmcError
from .mechanics import machine, physics
from .mechanics.physics.edits import AddedMass, BodyEdit, JointEdit
from .mechanics.physics.mujoco_plant import MujocoPlant
from .mechanics.robots.robot import Robot
from .output import films
from .simulation import loop
from .simulation.disturbances import (
    Disturbance,
    InputDisturbance,
    OutputDisturbance,
    Pulse,
    RateDisturbance,
)
from .simulation.simulate import simulate
from .simulation.trajectory import Trajectory, load_trajectory
from .studies.campaign.campaign import Campaign
from .studies.judging import judge
from .theory import control, plants
from .theory.control.controller import Controller, custom_controller
from .theory.control.coordinates.feedback_linearization import feedback_linearization
from .theory.control.design import linearized_lqr, regulating_grosmc, tracking_grosmc
from .theory.control.from_control import from_control
from .theory.control.lqr import lqr
from .theory.control.task import Realization, Task
from .theory.control.uncertainty.outputs import Uncertainty
from .theory.plants import AnalyticPlant, affine_plant

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
    "studies",
    "tracking_grosmc",
]

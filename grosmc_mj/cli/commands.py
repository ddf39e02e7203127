"""What the command line offers: one frozen dataclass a command, whose docstring is its help."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, arg, subcommand

from grosmc_mj.cli.campaign_commands import Campaign, Replay

Systems = Annotated[
    Positional[tuple[str, ...]],
    arg(metavar="[SYSTEM ...]", name="system", help_behavior_hint="(default: all of them)"),
]
System = Annotated[Positional[str], arg(metavar="SYSTEM", name="system")]


@dataclass(frozen=True)
class Validate:
    """Run the chapter's cases and say whether they come out as recorded.

    Every case of each SYSTEM (servo, cart_pendulum, arm, two_link_arm; all of them, if none is
    named) runs on the analytic plants (the chapter's printed equations where they are misprinted,
    and the corrected ones) and in MuJoCo, under LQR, GROSMC and what else its system has. A table
    goes to standard output; figures (PNG and SVG, numbered as in the chapter) and validation.json
    go to --out. The claims of the chapter are judged as by grosmc-mj claims.

    Exit code: 0 if every result and verdict is as the repository has it, 1 if one differs, 2 if the
    command or the set-up is wrong.

    Attributes:
        systems: Systems to run.
        case: Only this case: nominal, case1 or case2.
        engine: native compiles law and loop; python steps the same law in an ordinary loop,
            a few times slower and the same to rounding.
        control_period: Time between two samples of the law, in s; a multiple of the timestep.
        timestep: Physics timestep, in s.
        integrator: MuJoCo's integrator: RK4, implicitfast, implicit or Euler.
        switching: Switching law of the sliding mode laws: sign as in the chapter, boundary-layer,
            implicit, implicit-estimate, super-twisting, adaptive, unit-vector or
            implicit-unit-vector.
        surface: printed, or discrete: zero at every sample of the nominal plant.
        out: Folder for validation.json and the figures.
        claims: Whether to judge the chapter's claims too; this needs every case of a SYSTEM and
            the default settings.
        figures: Whether to draw the figures.
        films: Whether to end with a film of each case, LQR beside GROSMC, in DIR/films. One that is
            there already, drawn from the same data, is kept.
        record: Record the results as expected, for review; needs the default settings.
    """

    systems: Systems = ()
    case: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: every case)")] = (
        None
    )
    engine: Annotated[str, arg(metavar="native|python")] = "native"
    control_period: Annotated[float, arg(metavar="S")] = 1e-3
    timestep: Annotated[float, arg(metavar="S")] = 1e-3
    integrator: Annotated[str, arg(metavar="NAME")] = "RK4"
    switching: Annotated[str, arg(metavar="NAME")] = "sign"
    surface: Annotated[str, arg(metavar="printed|discrete")] = "printed"
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")
    claims: bool = True
    figures: bool = True
    films: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    record: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False


@dataclass(frozen=True)
class Run:
    """Run an experiment that a TOML file describes, and say whether it keeps what it requires.

    The file names a plant (a system of the package, an MJCF robot, or Python of your own), edits,
    disturbances, laws with their numbers, and requirements; grosmc-mj new writes one to begin with.
    The package's own cases are such files: servo/case1, cart_pendulum/case1 and so on, see
    grosmc-mj list. A table goes to standard output; NAME.json, NAME.png and NAME.svg to --out.

    Exit code: 0 if every requirement is kept, 1 if one is not, 2 if file or set-up is wrong.

    Attributes:
        file: A case file, or a case of the package.
        out: Folder for the results.
        figures: Whether to draw the figure.
        film: Whether to film its laws side by side in MuJoCo: DIR/films/NAME.mp4.
    """

    file: Annotated[Positional[str], arg(metavar="FILE", name="file")]
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")
    figures: bool = True
    film: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False


@dataclass(frozen=True)
class New:
    """Write a case file to begin with: NAME.toml, every key explained.

    Attributes:
        name: Name of the case, and of its file.
        like: Copy this case of the package instead, such as cart_pendulum/case1.
        python: Write NAME.py too, with a plant, a law and a controller of your own, and a case
            file that uses them.
    """

    name: Annotated[Positional[str], arg(metavar="NAME", name="name")]
    like: Annotated[str | None, arg(metavar="CASE", help_behavior_hint="")] = None
    python: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False


OptionalSystem = Annotated[
    Positional[str | None],
    arg(metavar="[SYSTEM]", name="system", help_behavior_hint="(default: all of them)"),
]


@dataclass(frozen=True)
class Claims:
    """Judge the chapter's claims: SUPPORTED, REFUTED or INCONCLUSIVE, each with its number.

    Every claim is measured on each plant that it can be asked of, at the control period and at half
    of it; a verdict that changes in between is inconclusive. A claim that fails because a premise
    failed says so. Writes claims.json to --out, with --explain claims/CLAIM.json, with --self-test
    self_test.json. Exit code 1 if a verdict is not the one that the repository expects.

    Attributes:
        system: servo, cart_pendulum, arm or two_link_arm.
        explain: Tell the whole story of this claim, and write its figure to --out.
        json: Print JSON instead of tables.
        self_test: Put faults into laws and plants, one at a time, and show which claims notice.
        page: Write the page on the chapter's defects, with its figures beside it.
        out: Folder for claims.json and figures.
    """

    system: OptionalSystem = None
    explain: Annotated[str | None, arg(metavar="CLAIM", help_behavior_hint="")] = None
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    self_test: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    page: Annotated[Path | None, arg(metavar="FILE.md", help_behavior_hint="")] = None
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")


@dataclass(frozen=True)
class Premises:
    """Check the premises of the chapter's theorems for a SYSTEM.

    For each case: controllability, G B, relative degree, matching, the input-gain ratio, the
    switching gain required against the one configured (with the input gain's uncertainty counted),
    s(0), singular states. Over the declared operating region and along the run: the least margin,
    where it is, how often it is violated, and the smallest gain that restores it.

    Attributes:
        system: servo, cart_pendulum, arm or two_link_arm.
        case: Only this case: nominal, case1 or case2.
        controller: Whose premises.
        out: Folder for premises_SYSTEM.json.
    """

    system: System
    case: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: every case)")] = (
        None
    )
    controller: Annotated[str, arg(metavar="NAME")] = "grosmc"
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")


@dataclass(frozen=True)
class List:
    """List the systems with their cases, plants and controllers."""


@dataclass(frozen=True)
class Compare:
    """Compare the analytic plants of a SYSTEM with MuJoCo.

    Prints the largest difference of the accelerations at random states, inputs and wrenches,
    and of an open-loop trajectory under wrenches, for the nominal model and for random edits of
    mass and length. Exit code 1 if the corrected equations do not agree to 1e-10.

    Attributes:
        system: servo, cart_pendulum, arm or two_link_arm.
        states: Random states of each comparison.
        edits: Random edits of mass (x0.25 to x4) and length (x0.5 to x4).
        seed: Of the random numbers.
        out: Folder for compare_SYSTEM.json.
    """

    system: System
    states: Annotated[int, arg(metavar="N")] = 1000
    edits: Annotated[int, arg(metavar="N")] = 5
    seed: Annotated[int, arg(metavar="N")] = 0
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")


@dataclass(frozen=True)
class Region:
    """Map from which starts each law of a SYSTEM converges, in MuJoCo.

    Each map has N x N starts of two states, by default the error of the controlled position and
    its rate; the other states start at rest. One map for each law on the nominal plant and on a
    perturbed one, under the law of the nominal. A start has converged if every error that the law
    regulates is within 1 degree and 0.1 rad/s (0.02 m and 0.1 m/s) at the end, or well within them
    at an earlier look; it has left the region if any sample of the law finds the state where the
    feedback linearization is undefined (the pole at or below the horizontal; the Jacobian LQR is
    stopped there too); the plant may be singular; or the run stays and does not converge.

    Writes region_SYSTEM.json, .png and .svg to --out, and a table to standard output.

    Attributes:
        system: servo, cart_pendulum, arm or two_link_arm.
        controllers: Laws to map, such as cart-ism and cart-pfl; by default those of validate.
        case: The perturbed plant: a case that edits bodies.
        points: Starts along each axis, from 2 to 1000.
        axes: Two states that the starts differ in, such as theta theta_dot or p theta.
        angle: Starts of an angle go from -DEG to DEG.
        rate: Starts of an angular rate go from -RATE to RATE, in rad/s.
        position: Starts of a position go from -M to M.
        speed: Starts of a speed go from -SPEED to SPEED, in m/s.
        duration: Time that a start is given to converge, in s.
        integrator: MuJoCo's integrator: implicitfast is the quickest; RK4, which the other commands
            use, takes four times as long.
        switching: Switching law of the sliding mode laws, as for validate.
        surface: printed or discrete, as for validate.
        out: Folder for region_SYSTEM.json and the figure.
    """

    system: System
    case: Annotated[
        str | None, arg(metavar="NAME", help_behavior_hint="(default: the first that edits bodies)")
    ] = None
    controllers: Annotated[
        tuple[str, ...],
        arg(metavar="NAME [NAME ...]", help_behavior_hint="(default: those of validate)"),
    ] = ()
    points: Annotated[int, arg(metavar="N")] = 100
    axes: Annotated[
        tuple[str, str] | None,
        arg(metavar="X Y", help_behavior_hint="(default: the controlled position and its rate)"),
    ] = None
    angle: Annotated[float, arg(metavar="DEG")] = 90.0
    rate: Annotated[float, arg(metavar="RATE")] = 10.0
    position: Annotated[float, arg(metavar="M")] = 1.0
    speed: Annotated[float, arg(metavar="SPEED")] = 2.0
    duration: Annotated[float, arg(metavar="S")] = 12.0
    integrator: Annotated[str, arg(metavar="NAME")] = "implicitfast"
    switching: Annotated[str, arg(metavar="NAME")] = "sign"
    surface: Annotated[str, arg(metavar="printed|discrete")] = "printed"
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")


@dataclass(frozen=True)
class Film:
    """Film a case of a SYSTEM: controllers side by side in MuJoCo, with their curves.

    Each controller runs once; the film replays the recorded states. A translucent ghost shows the
    nominal optimal trajectory x* (for the arm, the reference), a green arrow or arc the force or
    torque of the disturbance while it acts. The camera stands further back where an edited body
    would not fit. Beside FILE.mp4 (H.264, plays in every browser) lie a poster, FILE.png, and
    FILE.json with all that the film was made from.

    It renders off-screen with the backend that MUJOCO_GL names, else with the first that works of
    egl, osmesa and, where there is a display, glfw; grosmc-mj doctor says what is missing.

    Attributes:
        system: servo, cart_pendulum, arm or two_link_arm.
        case: nominal, case1 or case2.
        controllers: One to four of those that grosmc-mj list shows.
        camera: Camera of the model: fixed, follow or wide; by default follow where it moves along
            with the cart, else fixed.
        size: Width and height in pixels, both even.
        fps: Frames per second.
        speed: Seconds of the run in a second of the film.
        start: First instant shown, in s.
        stop: End of what is shown, in s.
        duration: How long the runs last, in s, where that is not the case's own time.
        output: The film; by default renders/films/SYSTEM_CASE.mp4.
        gif: Whether to write a small GIF too.
        workers: Rendering processes; by default one a core.
        probe: Whether to try the backends anew instead of trusting the last answer.
        switching: Switching law of the sliding mode laws, as for validate.
        surface: printed or discrete, as for validate.
    """

    system: System
    case: Annotated[str, arg(metavar="NAME")] = "case1"
    controllers: Annotated[tuple[str, ...], arg(metavar="NAME [NAME ...]")] = ("lqr", "grosmc")
    camera: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    size: Annotated[str, arg(metavar="WxH")] = "1280x720"
    fps: Annotated[int, arg(metavar="N")] = 30
    speed: Annotated[float, arg(metavar="X")] = 1.0
    start: Annotated[float, arg(name="from", metavar="T")] = 0.0
    stop: Annotated[
        float | None, arg(name="to", metavar="T", help_behavior_hint="(default: the run's end)")
    ] = None
    duration: Annotated[
        float | None, arg(metavar="S", help_behavior_hint="(default: the case's)")
    ] = None
    output: Annotated[
        Path | None, arg(aliases=("-o",), metavar="FILE.mp4", help_behavior_hint="")
    ] = None
    gif: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    workers: Annotated[int | None, arg(metavar="N", help_behavior_hint="")] = None
    probe: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    switching: Annotated[str, arg(metavar="NAME")] = "sign"
    surface: Annotated[str, arg(metavar="printed|discrete")] = "printed"


@dataclass(frozen=True)
class View:
    """Watch a case in MuJoCo's window, and push it.

    The closed loop runs as you watch, in real time and without end, or a recorded run is replayed.

    Keys: space pauses; . shows one picture more; + and - double and halve the speed; backspace
    starts again. Left and right push the uncertain body for 0.2 s (a force along x, or a torque
    where a force moves nothing), up and down make the push stronger and weaker; in a replay left
    and right go 1 s back and on. The mouse turns and moves the picture, [ and ] change the camera,
    Tab shows MuJoCo's own panel. Close the window or press Ctrl-C to end.

    Without a display it says so and names the command that makes a film. On macOS run it with
    mjpython -m grosmc_mj.cli view.

    Attributes:
        system: servo, cart_pendulum, arm or two_link_arm; or a case file, as for run.
        case: Of a system: nominal, case1 or case2; a file is one case.
        controller: One of those that grosmc-mj list shows, or of the file; grosmc by default, or
            a file's last one.
        replay: Whether to record the whole run first, and replay it.
        speed: Seconds of the run in a second.
        switching: Switching law of the sliding mode laws, as for validate.
        surface: printed or discrete, as for validate.
    """

    system: Annotated[Positional[str], arg(metavar="SYSTEM|FILE", name="system")]
    case: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: case1)")] = None
    controller: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    replay: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    speed: Annotated[float, arg(metavar="X")] = 1.0
    switching: Annotated[str, arg(metavar="NAME")] = "sign"
    surface: Annotated[str, arg(metavar="printed|discrete")] = "printed"


@dataclass(frozen=True)
class Switching:
    """Measure accuracy and chattering of six switching laws against sample time.

    On a scalar with a sine disturbance, whose input gain is right or wrong by a factor, and on the
    chapter's cases in MuJoCo under GROSMC, with the printed and with the discrete-time surface:
    largest |s|, distance from the optimal trajectory, zero crossings, total variation of the
    input, J of the whole input over J*. Tables go to standard output; switching.json and the
    figure, switching.png and switching.svg, to --out.

    Attributes:
        system: servo, cart_pendulum or arm.
        out: Folder for switching.json and the figure.
    """

    system: OptionalSystem = None
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")


@dataclass(frozen=True)
class Hold:
    """Hold the pole and the cart: what the chapter's law leaves out, and what it costs.

    The cart-pendulum runs in MuJoCo for 20 or 30 s in each case under the chapter's law, which
    lets the cart go, and under three that hold both: LQR of all four states, the same with section
    2's integral sliding mode, and section 3's linearization with an outer loop on the cart. With
    four states the pole's length is not matched: a second table says what each choice of G makes of
    that, a third how much of each uncertainty the input can reach. Writes hold.json, hold.png and
    hold.svg to --out.

    Attributes:
        switching: Switching law of the sliding mode laws, as for validate.
        surface: printed or discrete, as for validate.
        out: Folder for hold.json and the figure.
    """

    switching: Annotated[str, arg(metavar="NAME")] = "implicit"
    surface: Annotated[str, arg(metavar="printed|discrete")] = "discrete"
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")


@dataclass(frozen=True)
class Doctor:
    """Say what this machine has and, for each thing missing, the command that installs it.

    Prints versions, cores, the OpenGL backends (each is tried: it must render the right picture)
    and the ffmpeg that films are written with. Exit code 1 if films cannot be made.
    """


@dataclass(frozen=True)
class Bench:
    """Measure the closed loop's throughput as ratios to MuJoCo's own open loop.

    The pendulum runs under the full GROSMC law at every timestep, once and 1024 times at once.
    All loops are measured in turn in each round; ratios are medians over the rounds. Leave the
    machine alone meanwhile.

    Attributes:
        integrator: MuJoCo's integrator; by default both RK4, the model's own, and implicitfast.
        rounds: How often each loop is measured; by default 15 times, robots 5 and films 3 times.
        robot: Measure 1024 Jaco arms of dm_control with payloads instead.
        campaign: Measure a campaign of 4096 pendulums instead, its memory and its workers.
        films: Measure films instead: composed frames per second against bare mujoco.Renderer
            frames of the same size.
    """

    integrator: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="")] = None
    rounds: Annotated[int | None, arg(metavar="N", help_behavior_hint="")] = None
    robot: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    campaign: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    films: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False


@dataclass(frozen=True)
class Readme:
    """Write the table of results in a README anew from a validation.json.

    Attributes:
        readme: The file with the table between its two marks.
        results: What validate wrote.
    """

    readme: Path = Path("README.md")
    results: Path = Path("renders/validation.json")


Command = (
    Annotated[Validate, subcommand("validate")]
    | Annotated[Run, subcommand("run")]
    | Annotated[New, subcommand("new")]
    | Annotated[Campaign, subcommand("campaign")]
    | Annotated[Replay, subcommand("replay")]
    | Annotated[Claims, subcommand("claims")]
    | Annotated[Premises, subcommand("premises")]
    | Annotated[Film, subcommand("film")]
    | Annotated[List, subcommand("list")]
    | Annotated[View, subcommand("view")]
    | Annotated[Hold, subcommand("hold")]
    | Annotated[Compare, subcommand("compare")]
    | Annotated[Region, subcommand("region")]
    | Annotated[Switching, subcommand("switching")]
    | Annotated[Bench, subcommand("bench")]
    | Annotated[Doctor, subcommand("doctor")]
    | Annotated[Readme, subcommand("readme")]
)

ABOUT = (
    "Does a robust controller keep its promise on real physics, and where does it break? "
    "GROSMC (LQR made robust by an integral sliding surface) on the servo rotor, the "
    "cart-pendulum, the 1-DOF arm and a two-link arm: printed equations, corrected ones and "
    "MuJoCo, side by side. "
    "Exit codes: 0 done and kept, 1 something is not kept or not as recorded, 2 anything else that "
    "is wrong, 130 interrupted. --debug adds the traceback of an error."
)

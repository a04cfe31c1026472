"""Training recipes: one frozen dataclass a task, plain numbers that a reader may tune."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from aquaquad_envs.errors import check_choice, check_range

#: Seeds of evaluation suites lie below the first validation seed, those of training far above it.
VALIDATION_SEED = 2_000_000
FIRST_TRAINING_SEED = 2**40


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How one policy is trained.

    ``params`` are the task's parameters in training, ``validation`` those of the episodes that are
    evaluated now and then. ``algorithm_settings`` go to the Stable-Baselines3 constructor as they are.
    ``imitation_rounds`` > 0 begins with so many rounds of imitating the scripted policy ``expert``
    (DAgger: Ross, Gordon and Bagnell, AISTATS 2011), which spares the long patience that exploring needs.
    """

    task: str
    scenario: str
    algorithm: str
    num_worlds: int
    hidden: tuple[int, ...] = (128, 128)
    #: frame of the policy's vectors, one of ``agents.frames.FRAMES``
    frame: str = "world"
    params: dict[str, Any] = field(default_factory=dict)
    #: kinds of worlds that are practised side by side, as many of each: what differs in each from ``params``
    variants: tuple[dict[str, Any], ...] = ({},)
    validation: dict[str, Any] = field(default_factory=dict)
    algorithm_settings: dict[str, Any] = field(default_factory=dict)
    initial_log_std: float = -1.0
    imitation_rounds: int = 0
    #: the scripted policy that is imitated
    expert: str = "optimal"
    imitation_worlds: int = 256
    #: missions a round from each world: the first from its start, the others from anywhere
    imitation_missions: int = 16
    imitation_epochs: int = 20
    #: of the missions after the first of a round only so many decisions are played; None: all
    imitation_decisions: int | None = None
    #: residual from which an imitation's loss grows linearly, so that between two ways of acting it settles on the
    #: commoner, not on their mean; None: least squares
    imitation_huber: float | None = None
    #: parameters of the worlds that differ while imitating
    imitation_params: dict[str, Any] = field(default_factory=dict)
    #: whether missions after the first begin anywhere (drift-hop), else with the next seeds
    imitation_scatter: bool = False
    #: m by which obstacles are grown for the imitated expert
    imitation_margin_m: float = 150.0
    #: frames during which only the value function learns, so that it does not spoil an imitated policy
    value_warmup_frames: int = 0
    checkpoint_every: int = 500_000
    evaluate_every: int = 500_000
    evaluation_episodes: int = 200

    def with_overrides(self, **values: Any) -> Recipe:
        """A copy with every value that is not None replaced."""
        return replace(self, **{name: value for name, value in values.items() if value is not None})


_PPO = {
    "n_steps": 64,
    "batch_size": 4096,
    "n_epochs": 4,
    "gamma": 0.999,
    "gae_lambda": 0.95,
    # Small steps and little noise: training begins at an imitated policy, which large ones would wreck.
    "learning_rate": 1e-4,
    "clip_range": 0.2,
    "ent_coef": 0.0,
    "max_grad_norm": 0.5,
}
_SAC = {
    "learning_rate": 3e-4,
    "buffer_size": 1_000_000,
    "batch_size": 4096,
    "learning_starts": 50_000,
    "train_freq": 1,
    "gradient_steps": 8,
    "gamma": 0.999,
    "tau": 0.005,
}
_WORLD: dict[str, dict[str, Any]] = {
    # Starts spread over the map, so that every part of a long mission is practised from the first episode.
    "vortex": {"scenario": "vortex-perturbed", "start_anywhere": 0.7},
    # What fails is a landing on an obstacle: a large penalty makes the policy look where it lands.
    "gyres": {
        "scenario": "gyres",
        "field_seed": 1,
        "num_fields": 1024,
        "start_anywhere": 0.5,
        "failure_penalty": 20.0,
    },
}
_VALIDATION: dict[str, dict[str, Any]] = {
    "vortex": {"scenario": "vortex-perturbed"},
    "gyres": {"scenario": "gyres", "field_seed": 2, "num_fields": 200},
}


def drift_hop_recipe(scenario: str, algorithm: str) -> Recipe:
    """The recipe of drift/hop on ``scenario`` ("vortex" or "gyres") with "ppo" or "sac"."""
    check_choice("scenario", scenario, _WORLD)
    check_choice("algorithm", algorithm, ("ppo", "sac"))
    ppo = algorithm == "ppo"
    settings = dict(_PPO if ppo else _SAC)
    return Recipe(
        task="drift-hop",
        scenario=scenario,
        algorithm=algorithm,
        num_worlds=512 if ppo else 64,
        params=_WORLD[scenario],
        validation=_VALIDATION[scenario],
        algorithm_settings=settings,
        # Noise beyond a third of the drift threshold (0.1) turns most drifts of an imitated policy into hops.
        initial_log_std=(-3.5 if scenario == "vortex" else -3.0) if ppo else -1.0,
        imitation_rounds=10 if ppo else 0,
        # The optimum of one vortex can be imitated; that of every random field depends on more than is
        # observed, and its imitation misses the goal: there an expert that looks less far is the better start.
        imitation_params={"start_anywhere": 0.0},
        imitation_scatter=True,
        expert="optimal" if scenario == "vortex" else "greedy",
        frame="world" if scenario == "vortex" else "goal",
        imitation_worlds=24 if scenario == "vortex" else 512,
        imitation_missions=16 if scenario == "vortex" else 3,
        imitation_epochs=20 if scenario == "vortex" else 6,
        imitation_margin_m=150.0 if scenario == "vortex" else 100.0,
        value_warmup_frames=500_000 if ppo else 0,
    )


def sensor_placement_recipe(scenario: str, algorithm: str) -> Recipe:
    """The recipe of sensor placement in ``scenario`` with TDOA: "ppo" (parameters shared) or "mappo"."""
    check_choice("scenario", scenario, ("calm", "vortex", "gyres"))
    check_choice("algorithm", algorithm, ("ppo", "mappo"))
    # A lost vehicle costs more in training: survivors are what most separates a learned team from the planner's.
    params: dict[str, Any] = {
        "scenario": scenario,
        "measurement": "tdoa",
        "failure_penalty": 40.0,
        "acquisition_weight": 10.0,
        "energy_weight": 0.4,
    }
    fields = {"field_seed": 1, "num_fields": 512} if scenario == "gyres" else {}
    checks = {"field_seed": 2, "num_fields": 200} if scenario == "gyres" else {}
    return Recipe(
        task="sensor-placement",
        scenario=scenario,
        algorithm=algorithm,
        num_worlds=192,
        params={**params, **fields},
        # Some missions end after six decisions: the first ones of a badly placed team are practised most. Others are in
        # random fields among random obstacles.
        variants=({}, {"horizon_s": 1800.0}, {"scenario": "gyres", "field_seed": 1, "num_fields": 512}),
        validation={**params, **checks},
        # What a hop does to the geometry shows within hours.
        algorithm_settings={**_PPO, "gamma": 0.98, "learning_rate": 5e-5},
        frame="goal",
        initial_log_std=-4.0,
        hidden=(256, 256),
        imitation_rounds=12,
        expert="hop-in-turn",
        imitation_worlds=128,
        # The first decisions decide the RMSE of a mission that starts badly placed, and are few among all.
        imitation_missions=12,
        imitation_decisions=6,
        imitation_huber=0.1,
        imitation_epochs=6,
        imitation_margin_m=0.0,
        value_warmup_frames=300_000,
        evaluation_episodes=200,
    )


def transponder_localization_recipe(scenario: str, algorithm: str) -> Recipe:
    """The recipe of transponder localization in ``scenario`` ("random" or "current"), yaw-rate vehicle, with "ppo".

    Observations know no north: one lesson serves all headings, and the policy needs no frame of its own.
    """
    check_choice("scenario", scenario, ("random", "current"))
    check_choice("algorithm", algorithm, ("ppo",))
    fields = {"field_seed": 1, "num_fields": 512} if scenario == "current" else {}
    checks = {"field_seed": 2, "num_fields": 200} if scenario == "current" else {}
    return Recipe(
        task="transponder-localization",
        scenario=scenario,
        algorithm=algorithm,
        num_worlds=512,
        params={"scenario": scenario, **fields},
        validation={"scenario": scenario, **checks},
        # What a turn does to the geometry shows within ten of the thirty measurements; small steps, with little noise,
        # keep what was imitated of the first ones. The shipped policy has a second stage (docs/training.md).
        algorithm_settings={**_PPO, "gamma": 0.98, "n_steps": 32, "learning_rate": 1e-4},
        hidden=(256, 256),
        initial_log_std=-2.0,
        imitation_rounds=8,
        expert="omlp-3",
        imitation_worlds=512,
        imitation_missions=4,
        imitation_epochs=6,
        imitation_huber=0.1,
        imitation_margin_m=0.0,
        value_warmup_frames=300_000,
        evaluation_episodes=400,
    )


def laser_tracking_recipe(scenario: str, algorithm: str) -> Recipe:
    """The recipe of laser tracking under a flat top with "ppo": every motion below, dark or with ambient light.

    Memory is in the observation: readings and places up to 3.2 s back, where the light must be, where it is dark.
    """
    check_choice("scenario", scenario, ("flat-top", "daylight"))
    check_choice("algorithm", algorithm, ("ppo",))
    # Light is received beyond the detectable area too, which is what counts.
    params: dict[str, Any] = {
        "scenario": "mixed",
        "profile": "flat-top",
        "light_weight": 0.2,
        "area_weight": 1.0,
    }
    if scenario == "daylight":
        params |= {"ambient_w_m2": 0.004, "ambient_variation": 0.35, "noise_std_w_m2": 8e-4}
    return Recipe(
        task="laser-tracking",
        scenario=scenario,
        algorithm=algorithm,
        num_worlds=256,
        params=params,
        validation=params,
        # Twenty seconds ahead: long enough to get back into the light, and to go round a search's circle.
        algorithm_settings={**_PPO, "n_steps": 128, "batch_size": 8192, "gamma": 0.995},
        frame="goal",
        hidden=(256, 128),
        initial_log_std=-2.5,
        imitation_rounds=10,
        expert="memory-tracking",
        imitation_worlds=96,
        imitation_missions=1,
        imitation_epochs=6,
        value_warmup_frames=500_000,
        checkpoint_every=1_000_000,
        evaluate_every=1_000_000,
    )


def plume_tracing_recipe(scenario: str, algorithm: str) -> Recipe:
    """The recipe of plume tracing in ``scenario`` with ten robots: "ppo" (parameters shared) or "mappo"."""
    check_choice("scenario", scenario, ("advected", "turbulent"))
    check_choice("algorithm", algorithm, ("ppo", "mappo"))
    return Recipe(
        task="plume-tracing",
        scenario=scenario,
        algorithm=algorithm,
        num_worlds=64,
        hidden=(256, 128),
        params={"scenario": scenario, "field_seed": 1, "num_fields": 512},
        validation={"scenario": scenario, "field_seed": 2, "num_fields": 200},
        # A whiff is followed for tens of updates, not hundreds; steps as large as a fresh start allows.
        algorithm_settings={**_PPO, "gamma": 0.99, "learning_rate": 2e-4},
        # Upstream looks the same whatever the course of the current.
        frame="goal",
        initial_log_std=-1.5,
        imitation_rounds=6,
        expert="spiral-surge",
        imitation_worlds=48,
        # The expert remembers how far it has searched: each mission needs one that has just begun.
        imitation_missions=1,
        imitation_epochs=8,
        imitation_margin_m=0.0,
        value_warmup_frames=300_000,
    )


RECIPES = {
    "drift-hop": drift_hop_recipe,
    "sensor-placement": sensor_placement_recipe,
    "transponder-localization": transponder_localization_recipe,
    "laser-tracking": laser_tracking_recipe,
    "plume-tracing": plume_tracing_recipe,
}


def make_recipe(task: str, scenario: str, algorithm: str) -> Recipe:
    """The recipe for a task; raises ``InvalidParameterError`` naming what there is."""
    check_choice("task", task, RECIPES)
    return RECIPES[task](scenario, algorithm)


def check_steps(steps: int) -> None:
    """Raise ``InvalidParameterError`` unless ``steps`` is a sensible number of frames."""
    check_range("steps", steps, 1, 10**12)

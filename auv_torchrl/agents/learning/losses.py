"""Losses: TorchRL's, with the networks of this package; for soft actor-critic also that of fused.py."""

from torchrl.modules import ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss, SACLoss, TD3Loss, ValueEstimators

from auv_torchrl.agents.learning.fused import FusedSACLoss
from auv_torchrl.agents.networks import Device, make_actor, make_critic, make_policy, make_value, set_spread

LOSSES = {"fused": FusedSACLoss, "stock": SACLoss}


def make_loss(
    name: str | type[SACLoss],
    observations: int,
    actions: int,
    hidden: tuple[int, ...],
    gamma: float,
    target_entropy: float,
    alpha_init: float,
    distance: str = "l1",
    device: Device = "cpu",
) -> SACLoss:
    """Actor, twin critics and their targets in one loss module: ``"fused"``, ``"stock"``, or a class of one's own.

    ``distance`` of the critics from what they should say is ``"l1"``, ``"l2"`` or ``"smooth_l1"``.
    """
    loss = (LOSSES[name] if isinstance(name, str) else name)(
        actor_network=make_actor(observations, actions, hidden, device),
        qvalue_network=make_critic(observations, actions, hidden, device),
        num_qvalue_nets=2,
        loss_function=distance,
        alpha_init=alpha_init,
        target_entropy=target_entropy,
        delay_qvalue=True,
    )
    loss.make_value_estimator(ValueEstimators.TD0, gamma=gamma)
    return loss


def make_td3_loss(
    observations: int,
    actions: int,
    hidden: tuple[int, ...],
    gamma: float,
    exploration: float,
    target_noise: float,
    target_noise_limit: float,
    device: Device = "cpu",
) -> TD3Loss:
    """Actor, twin critics and the targets of all in TorchRL's loss module.

    The actor has the spread ``exploration`` before its tanh where it explores, which nothing changes.
    """
    actor = make_policy(observations, actions, hidden, device)
    set_spread(actor, exploration)
    loss = TD3Loss(
        actor_network=actor,
        qvalue_network=make_critic(observations, actions, hidden, device),
        bounds=(-1.0, 1.0),  # pyright: ignore[reportArgumentType]  # its type says one number
        policy_noise=target_noise,
        noise_clip=target_noise_limit,
        loss_function="l2",
    )
    loss.make_value_estimator(ValueEstimators.TD0, gamma=gamma)
    return loss


def make_ppo_loss(
    observations: int, actions: int, hidden: tuple[int, ...], clip: float, entropy: float, device: Device = "cpu"
) -> tuple[ProbabilisticActor, ValueOperator, ClipPPOLoss]:
    """Actor, value of an observation, and both in TorchRL's loss module, which shares their weights."""
    actor, value = make_actor(observations, actions, hidden, device), make_value(observations, hidden, device)
    loss = ClipPPOLoss(
        actor_network=actor,
        critic_network=value,
        clip_epsilon=clip,
        entropy_coeff=entropy,
        loss_critic_type="l2",
        normalize_advantage=True,
    )
    return actor, value, loss

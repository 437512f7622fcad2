"""Directions of nuisance parameters that a log cannot tell: they are not fitted to it."""

from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.quadratics import quadratic
from auv_torchrl.diagnosis.thresholds import TELLS, UNTOLD


def hold_unseen(problem: Problem, follow: WindowPath) -> Problem:
    """The problem with nuisance parameters as wide as they are only along directions of which its windows tell.

    Healthy flights leave open what changes no motion, as twice the inertia with twice the thrust and drag. Such a
    direction costs a fit nothing to first order, and the fit would go to its bound for no reason. The intervals of the
    fitted values take the whole width (:func:`auv_torchrl.diagnosis.identify.sure.as_sure`).
    """
    A = quadratic(problem, follow, [], chosen=problem.followed).A
    if not np.isfinite(A).all():
        return problem
    size, direction = np.linalg.eigh(problem.nuisance_covariance)
    root = direction * np.sqrt(np.maximum(size, 0.0))
    told, along = np.linalg.eigh(root.T @ A @ root)  # in standard deviations of nuisance parameters
    share = np.where(told < TELLS, UNTOLD, 1.0)
    held = root @ along * share
    covariance = held @ held.T
    widths = np.sqrt(np.diag(covariance)).tolist()
    nuisance = tuple((*entry[:3], width) for entry, width in zip(problem.nuisance, widths, strict=True))
    precision = np.linalg.inv(covariance)
    return replace(problem, nuisance=nuisance, nuisance_covariance=covariance, nuisance_precision=precision)

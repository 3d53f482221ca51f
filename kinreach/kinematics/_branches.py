"""Choosing a branch: by its index, by words such as "right, up, straight", or the one in which the arm is."""

from __future__ import annotations

import numpy as np

from kinreach._checks import Floats, check_count
from kinreach._rotations import joints_apart
from kinreach.errors import InputError, UnknownNameError, raise_unknown
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._closed_form import ClosedFormKinematics
from kinreach.kinematics._solutions import IKSolutions

#: The branch of the start posture.
SAME = "same"
#: A posture is a solution of its own pose to this [rad].
OWN = 1e-5


def postures_of(kinematics: ArmKinematics, solutions: IKSolutions, branch: int | str, start: Floats) -> Floats:
    """Return the postures of a pose that are of a branch [rad], shape (k, n).

    Args:
        kinematics: Which the solutions come from.
        solutions: Of a pose; at least one.
        branch: Index; words of `branch_words`, all or some of them: "right, up"; or "same" for that of the start.
        start: Posture [rad], shape (n,).

    Raises:
        InputError: No posture is of that branch, or the arm's branches have no words, or only count.
        UnknownNameError: Another word.
    """
    if not isinstance(kinematics, ClosedFormKinematics):
        raise InputError(f"{kinematics.arm.title} has no closed form, so its postures have no branches")
    found = solutions.branch
    if not isinstance(branch, str):
        chosen = found == check_count("branch", branch, least=0, most=kinematics.branches - 1)
    elif branch.strip() == SAME:
        chosen = found == branch_of(kinematics, start)
    else:
        asked, known = _words(kinematics, branch), [kinematics.branch_words(index) for index in found.tolist()]
        chosen = np.array([asked <= set(words) for words in known])
    if not chosen.any():
        there = "; ".join(described(kinematics, index) for index in sorted(set(found.tolist())))
        raise InputError(f"the goal has no posture of branch {branch!r}; it has {there}")
    return solutions.q[chosen]


def branch_of(kinematics: ClosedFormKinematics, q: Floats) -> int:
    """Return the index of the branch in which a posture [rad] is.

    Raises:
        InputError: The arm's branches only count, or the posture is singular and in none.
    """
    if not kinematics.has_named_branches:
        raise InputError(f"the branches of {kinematics.arm.title} only count the postures of a pose; give their number")
    solutions = kinematics.all_solutions(kinematics.fk(q), seed=q, limits=False)
    off = joints_apart(solutions.q, q)
    if not len(off) or off.min() > OWN:
        raise InputError("the start is in no branch: it is singular")
    return int(solutions.branch[off.argmin()])


def described(kinematics: ClosedFormKinematics, branch: int) -> str:
    """Return the index of a branch with its words, such as "6 (right, up, straight)"."""
    words = ", ".join(kinematics.branch_words(branch))
    return f"{branch} ({words})" if words else str(branch)


def _words(kinematics: ClosedFormKinematics, text: str) -> set[str]:
    known = {word for branch in range(kinematics.branches) for word in kinematics.branch_words(branch)}
    if not known:
        raise InputError(f"the branches of {kinematics.arm.title} have no names; give their number, or {SAME!r}")
    asked = set(text.lower().replace(",", " ").split())
    if not asked:
        raise InputError("branch must be a number, words, or 'same'; it is empty")
    try:
        for word in asked - known:
            raise_unknown("word of a branch", word, [*known, SAME])
    except UnknownNameError as error:
        raise InputError(str(error)) from None
    return asked

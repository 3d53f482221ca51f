"""An arm of six joints as text, in which something is as in files that people have."""

from __future__ import annotations

from collections.abc import Mapping

LIMIT = '<limit lower="-3.1" upper="3.1" effort="1" velocity="1"/>'
RIGHT = "1.5707963267948966"
#: Place of each joint in the one before.
PLACES = (
    ("0 0 0.15", "0 0 0"), ("0 0.1 0", f"{RIGHT} 0 0"), ("0.4 0 0", "0 0 0"), ("0.35 0 0", "0 0 0"),
    ("0 -0.1 0", f"{RIGHT} 0 0"), ("0 0.09 0", f"-{RIGHT} 0 0"),
)  # fmt: skip
MASS = '<inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'


def joint(name: str, parent: str, child: str, *, kind: str = "revolute", inside: str = LIMIT, **parts: str) -> str:
    """A joint; `parts` are its `origin` and `axis`, elements as text."""
    axis = parts.get("axis", '<axis xyz="0 0 1"/>')
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"{parts.get('origin', '')}{axis}{inside}</joint>"
    )


def arm(
    *,
    links: Mapping[int, str] | None = None,
    joints: Mapping[int, Mapping[str, str]] | None = None,
    more: str = "",
    head: str = '<robot name="a">',
) -> str:
    """A URDF of six joints j1 to j6 and links l0 to l6.

    Args:
        links: What is in some of the links.
        joints: Arguments of `joint` for some of the joints.
        more: What else is in the robot.
        head: Its first tag.
    """
    text = "".join(f'<link name="l{i}">{(links or {}).get(i, "")}</link>' for i in range(7))
    for i, (xyz, rpy) in enumerate(PLACES, start=1):
        parts = {"origin": f'<origin xyz="{xyz}" rpy="{rpy}"/>'} | dict((joints or {}).get(i, {}))
        text += joint(f"j{i}", f"l{i - 1}", f"l{i}", **parts)
    return f"{head}{text}{more}</robot>"


def shape(solid: str, kind: str = "visual", more: str = "") -> str:
    return f"<{kind}><geometry>{solid}</geometry>{more}</{kind}>"


def limits(text: str, *which: int) -> dict[int, dict[str, str]]:
    """Joints with other limits, for `arm`."""
    return {i: {"inside": f"<limit {text}/>"} for i in which}

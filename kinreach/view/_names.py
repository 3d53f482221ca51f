"""Names of postures, links and joints, and text for angles and lengths."""

from __future__ import annotations

from math import degrees

from kinreach.kinematics import Arm3Kinematics, ArmKinematics, URKinematics


def branch_name(kinematics: ArmKinematics, branch: int) -> str:
    if isinstance(kinematics, URKinematics) and (words := kinematics.branch_words(branch)):
        shoulder, elbow, wrist = words
        return f"shoulder {shoulder}, elbow {elbow}, wrist {wrist}"
    if isinstance(kinematics, Arm3Kinematics):
        return f"{'over the back' if branch >> 1 else 'to the front'}, elbow {'B' if branch & 1 else 'A'}"
    return f"posture {branch + 1}"


def plain(name: str) -> str:
    """Return the name of a link or joint without its suffix."""
    for ending in ("_link", "_joint"):
        name = name.removesuffix(ending)
    return name.replace("_", " ")


def angle(value: float, digits: int = 0) -> str:
    """Write an angle [rad] in degrees."""
    return f"{round(degrees(value), digits) + 0.0:.{digits}f}°"  # no -0°


def place(value: float, digits: int = 0, *, slides: bool) -> str:
    """Write where a joint is [rad, m]: in degrees, or in metres to the millimetre."""
    return f"{round(value, 3) + 0.0:.3f} m" if slides else angle(value, digits)


def length(value: float) -> str:
    """Write a length [m] in millimetres with about two digits, in micrometres where it is very short."""
    if 0.0 < value < 1e-5:
        return "< 1 µm" if value < 1e-6 else f"{1e6 * value:.0f} µm"
    digits = 0 if value >= 0.01 or value == 0.0 else 1 if value >= 0.001 else 2
    return f"{1000 * value:.{digits}f} mm"

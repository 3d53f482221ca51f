"""urx: state from ports 30002 and 30003, and moves.

Its `URRobot`: the poses of its `Robot` need math3d 3 (Python before 3.10).
"""

import logging
import sys
from importlib.metadata import version

from calls import connected, eventually, near, report
from urx.urrobot import URRobot
from urx.ursecmon import TimeoutException


def main(address: str) -> None:
    """Try urx on the robot at an address."""
    logging.disable()
    robot = connected(lambda: URRobot(address, use_rt=True), TimeoutException)

    def joints() -> list[float]:
        return robot.getj(wait=True)

    def moved(q: list[float]) -> bool:
        robot.movej(q, acc=3.0, vel=1.0, wait=False)
        return eventually(lambda: near(joints(), q))

    def stopped() -> bool:
        robot.movej([home[0] + 1.0, *home[1:]], acc=1.0, vel=0.3, wait=False)
        begun = eventually(lambda: joints()[0] - home[0] > 0.01 and robot.is_program_running())
        robot.stopj(3.0)
        ended = eventually(lambda: not robot.is_program_running())
        return begun and ended and joints()[0] - home[0] < 0.95

    def lifted() -> bool:
        pose = robot.getl(wait=True)
        pose[2] += 0.03
        robot.movel(pose, acc=1.0, vel=0.2, wait=False)
        return eventually(lambda: near(robot.getl(wait=True), pose))

    home = joints()
    report("urx", version("urx"), {
        "getj": lambda: len(joints()) == 6,
        "getl": lambda: len(robot.getl(wait=True)) == 6,
        "is_program_running": lambda: not robot.is_program_running(),
        "movej(wait=False)": lambda: moved([home[0] + 0.2, *home[1:]]) and moved(home),
        "stopj": lambda: stopped() and moved(home),
        "movel(wait=False)": lambda: lifted() and moved(home),
        "rtmon.q_actual": lambda: near(list(robot.rtmon.q_actual(wait=True)), home),
        "rtmon.tcf_pose": lambda: near(list(robot.rtmon.tcf_pose(wait=True))[:3], robot.getl(wait=True)[:3]),
        "set_tcp": lambda: robot.set_tcp((0, 0, 0.1, 0, 0, 0)),
        "set_payload": lambda: robot.set_payload(0.5, (0, 0, 0)),
        "send_program": lambda: robot.send_program("set_digital_out(2, True)"),
        "get_digital_out_bits": lambda: robot.get_digital_out_bits(wait=True) == 4,
        "movej(wait=True)": lambda: robot.movej(home, acc=3.0, vel=1.0),
    })  # fmt: skip
    robot.close()


if __name__ == "__main__":
    main(sys.argv[1])

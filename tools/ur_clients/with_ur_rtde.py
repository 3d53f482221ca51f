"""ur_rtde: its dashboard, receive, I/O and control interfaces."""

import sys
from importlib.metadata import version

import dashboard_client
import rtde_control
import rtde_io
import rtde_receive
from calls import connected, eventually, near, report


def main(address: str) -> None:
    """Try ur_rtde on the robot at an address."""
    release = version("ur_rtde")
    dashboard = dashboard_client.DashboardClient(address)
    dashboard.connect()
    report("ur_rtde: dashboard", release, {
        "robotmode": lambda: dashboard.robotmode() == "Robotmode: RUNNING",
        "safetymode": lambda: dashboard.safetymode() == "Safetymode: NORMAL",
        "safetystatus": lambda: dashboard.safetystatus() == "Safetystatus: NORMAL",
        "running": lambda: not dashboard.running(),
        "programState": lambda: dashboard.programState().startswith("STOPPED"),
        "polyscopeVersion": lambda: dashboard.polyscopeVersion() == "5.12.0.0",
        "getRobotModel": lambda: dashboard.getRobotModel() == "UR5",
        "getSerialNumber": lambda: dashboard.getSerialNumber().isdigit(),
        "isInRemoteControl": lambda: dashboard.isInRemoteControl(),
        "popup": lambda: dashboard.popup("hello"),
        "closePopup": lambda: dashboard.closePopup(),
        "addToLog": lambda: dashboard.addToLog("a line"),
        "powerOff": lambda: dashboard.powerOff() or eventually(lambda: "POWER_OFF" in dashboard.robotmode()),
        "powerOn": lambda: dashboard.powerOn() or eventually(lambda: "IDLE" in dashboard.robotmode()),
        "brakeRelease": lambda: dashboard.brakeRelease() or eventually(lambda: "RUNNING" in dashboard.robotmode()),
        "closeSafetyPopup": lambda: dashboard.closeSafetyPopup(),
        "unlockProtectiveStop": lambda: dashboard.unlockProtectiveStop(),
    })  # fmt: skip

    robot = rtde_receive.RTDEReceiveInterface(address)
    outputs = rtde_io.RTDEIOInterface(address)
    home, pose = robot.getActualQ(), robot.getActualTCPPose()
    report("ur_rtde: receive", release, {
        "getActualQ": lambda: len(robot.getActualQ()) == 6,
        "getTargetQ": lambda: near(robot.getTargetQ(), home),
        "getActualTCPPose": lambda: len(robot.getActualTCPPose()) == 6,
        "getActualTCPSpeed": lambda: near(robot.getActualTCPSpeed(), [0.0] * 6),
        "getTimestamp": lambda: robot.getTimestamp() > 0.0,
        "getRobotMode": lambda: robot.getRobotMode() == 7,
        "getSafetyMode": lambda: robot.getSafetyMode() == 1,
        "isProtectiveStopped": lambda: not robot.isProtectiveStopped(),
        "getRuntimeState": lambda: robot.getRuntimeState() == 1,
    })  # fmt: skip
    report("ur_rtde: I/O", release, {
        "setStandardDigitalOut": lambda: outputs.setStandardDigitalOut(3, True)
        and eventually(lambda: robot.getActualDigitalOutputBits() & 1 << 3),
        "setConfigurableDigitalOut": lambda: outputs.setConfigurableDigitalOut(0, True)
        and eventually(lambda: robot.getActualDigitalOutputBits() & 1 << 8),
        "setToolDigitalOut": lambda: outputs.setToolDigitalOut(0, True)
        and eventually(lambda: robot.getActualDigitalOutputBits() & 1 << 16),
        "setAnalogOutputVoltage": lambda: outputs.setAnalogOutputVoltage(0, 0.5),
        "setSpeedSlider": lambda: outputs.setSpeedSlider(0.5)
        and eventually(lambda: robot.getTargetSpeedFraction() == 0.5)
        and outputs.setSpeedSlider(1.0)
        and eventually(lambda: robot.getSpeedScaling() == 1.0),
    })  # fmt: skip
    outputs.disconnect()

    control = connected(lambda: rtde_control.RTDEControlInterface(address), RuntimeError)
    away = [home[0] + 0.2, *home[1:]]
    path = [[*away, 2.0, 4.0, 0.0], [home[0] + 0.3, home[1] + 0.1, *home[2:], 2.0, 4.0, 0.05], [*home, 2.0, 4.0, 0.0]]
    higher = [pose[0], pose[1], pose[2] + 0.05, *pose[3:]]
    line = [[*higher, 0.5, 2.0, 0.0], [pose[0] + 0.05, pose[1], pose[2] + 0.05, *pose[3:], 0.5, 2.0, 0.01],
            [*pose, 0.5, 2.0, 0.0]]  # fmt: skip

    def at(q: list[float]) -> bool:
        return eventually(lambda: near(robot.getActualQ(), q))

    def moves() -> bool:
        return eventually(lambda: max(map(abs, robot.getTargetQd())) > 0.02)

    def stands() -> bool:
        return eventually(lambda: max(map(abs, robot.getTargetQd())) == 0.0)

    def is_async_done() -> bool:
        return eventually(lambda: control.getAsyncOperationProgress() < 0)

    def servo() -> bool:
        for step in range(50):
            begun = control.initPeriod()
            control.servoJ([home[0] + 0.001 * step, *home[1:]], 0.0, 0.0, 0.002, 0.1, 300)
            control.waitPeriod(begun)
        return control.servoStop() and stands() and robot.getActualQ()[0] - home[0] > 0.01

    def stopped_on_the_way() -> bool:
        control.moveJ([home[0] + 1.0, *home[1:]], 0.3, 1.0, True)
        begun = eventually(lambda: robot.getActualQ()[0] - home[0] > 0.1)
        begun = begun and eventually(lambda: control.getAsyncOperationProgressEx().isAsyncOperationRunning())
        control.stopJ(3.0)
        return begun and stands() and robot.getActualQ()[0] - home[0] < 0.95

    def uploaded_again() -> bool:
        control.stopScript()
        ended = eventually(lambda: not control.isProgramRunning())
        return ended and control.reuploadScript() and eventually(control.isProgramRunning)

    def unlocked() -> bool:
        control.triggerProtectiveStop()
        stopped = eventually(robot.isProtectiveStopped)

        def unlock() -> bool:
            try:
                dashboard.unlockProtectiveStop()
            except RuntimeError:  # in the first 5 s
                return False
            return not robot.isProtectiveStopped()

        return stopped and eventually(unlock) and control.reuploadScript() and eventually(control.isProgramRunning)

    report("ur_rtde: control", release, {
        "moveJ": lambda: control.moveJ(away, 2.0, 4.0) and at(away),
        "moveJ_IK": lambda: control.moveJ_IK(pose, 2.0, 4.0) and at(home),
        "moveL": lambda: control.moveL(higher, 0.5, 2.0) and eventually(lambda: near(robot.getActualTCPPose(), higher)),
        "moveL_FK": lambda: control.moveL_FK(home, 0.5, 2.0) and at(home),
        "moveJ and moveL of a path with blends": lambda: control.moveJ(path) and at(home) and control.moveL(line)
        and at(home),
        "asynchronous moves, getAsyncOperationProgress": lambda: control.moveJ(path, True) and is_async_done()
        and at(home),
        "stopJ": lambda: stopped_on_the_way() and control.moveJ(home, 2.0, 4.0),
        "speedJ": lambda: control.speedJ([0.2, 0, 0, 0, 0, 0], 1.0) and moves() and control.speedStop()
        and stands() and control.moveJ(home, 2.0, 4.0),
        "speedL": lambda: control.speedL([0, 0, 0.05, 0, 0, 0], 0.5) and moves() and control.speedStop()
        and stands() and control.moveJ(home, 2.0, 4.0),
        "servoJ": lambda: servo() and control.moveJ(home, 2.0, 4.0),
        "jogStart, jogStop": lambda: control.jogStart([0, 0, 0.05, 0, 0, 0]) and moves()
        and control.jogStop() and stands() and control.moveJ(home, 2.0, 4.0),
        "getInverseKinematics": lambda: near(control.getInverseKinematics(higher, home),
                                             control.getInverseKinematics(higher)),
        "getInverseKinematicsHasSolution": lambda: control.getInverseKinematicsHasSolution(pose)
        and not control.getInverseKinematicsHasSolution([3.0, *pose[1:]]),
        "getForwardKinematics()": lambda: near(control.getForwardKinematics()[:3], pose[:3]),
        "poseTrans": lambda: near(control.poseTrans(pose, [0, 0, 0.1, 0, 0, 0])[:2], pose[:2]),
        "setTcp, getTCPOffset": lambda: control.setTcp([0, 0, 0.1, 0, 0, 0])
        and near(control.getTCPOffset(), [0, 0, 0.1, 0, 0, 0]) and control.setTcp([0] * 6),
        "setPayload": lambda: control.setPayload(1.5, [0, 0, 0.1]) and eventually(lambda: robot.getPayload() == 1.5),
        "isPoseWithinSafetyLimits": lambda: control.isPoseWithinSafetyLimits(pose),
        "isSteady": lambda: eventually(control.isSteady),
        "isProgramRunning, stopScript, reuploadScript": uploaded_again,
        "triggerProtectiveStop": unlocked,
        "moveJ after it": lambda: control.moveJ(away, 2.0, 4.0) and at(away),
    })  # fmt: skip
    control.disconnect()
    robot.disconnect()
    dashboard.disconnect()


if __name__ == "__main__":
    main(sys.argv[1])

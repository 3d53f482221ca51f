"""Try other people's clients on `kinreach simulate-ur`: `python -m tools.ur_clients`.

Each client runs in a process of its own, with the interpreter that has it. The table is docs/reference/ur_clients.md.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "reference" / "ur_clients.md"
MARK = "<!-- made by `make ur-clients` -->\n\n"
CLIENTS = {"ur_rtde": "with_ur_rtde.py", "urx": "with_urx.py"}
#: Why a call does not work, for those that are known not to.
REASONS = {
    ("urx", "get_digital_out_bits"): "0 with every controller since 3.5, whose version 0.11.0 does not recognize",
    ("urx", "movej(wait=True)"): "\"Robot stopped\" with every controller since 3.5, for the same reason",
}  # fmt: skip


def tried(client: str, address: str, python: str) -> list[dict[str, object]]:
    """Run the calls of a client, and return what became of each."""
    done = subprocess.run(
        [python, str(HERE / CLIENTS[client]), address], capture_output=True, text=True, check=False, timeout=900
    )
    rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode != 0 or not rows:
        raise SystemExit(f"{client}:\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}")
    return rows


def simulated(address: str) -> subprocess.Popen[str]:
    """Start a simulated UR5e, and return its process when it serves."""
    robot = subprocess.Popen(
        [sys.executable, "-m", "kinreach", "simulate-ur", "--arm", "ur5e", "--address", address],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert robot.stdout is not None
    if address not in (first := robot.stdout.readline()):
        raise SystemExit(first + robot.stdout.read())
    return robot


def table(rows: list[dict[str, object]]) -> str:
    """Return the table of what works."""
    lines = ["| client | version | works | does not |", "|---|---|---|---|"]
    for part in dict.fromkeys(row["part"] for row in rows):
        of_part = [row for row in rows if row["part"] == part]
        works = ", ".join(f"`{row['call']}`" for row in of_part if row["works"])
        fails = "; ".join(
            f"`{row['call']}`: {REASONS.get((str(part), str(row['call'])), row['why'])}"
            for row in of_part if not row["works"]
        )  # fmt: skip
        lines.append(f"| {part} | {of_part[0]['version']} | {works} | {fails} |")
    return "\n".join(lines) + "\n"


def main(argv: list[str] | None = None) -> int:
    """Print the table, and write or compare it; return 1 if the page has another one."""
    parser = argparse.ArgumentParser(prog="python -m tools.ur_clients", description=__doc__)
    parser.add_argument("--python", default=sys.executable, help="interpreter that has the clients (this one)")
    parser.add_argument("--client", choices=CLIENTS, action="append", help="only this one")
    parser.add_argument("--address", default="127.0.29.99", help="of the simulated robot (%(default)s)")
    parser.add_argument("--write", action="store_true", help="put the table into the page")
    parser.add_argument("--check", action="store_true", help="fail if the page has another table")
    arguments = parser.parse_args(argv)
    rows = list[dict[str, object]]()
    for client in arguments.client or CLIENTS:
        for last in (False, True):  # a client's own limits of 0.5 to 5 s run out on a machine that is busy
            robot = simulated(arguments.address)
            try:
                these = tried(client, arguments.address, arguments.python)
            finally:
                robot.terminate()
                robot.communicate(timeout=60)
            failed = [row for row in these if not row["works"] and (client, row["call"]) not in REASONS]
            if not failed or last:
                break
            print(f"{failed}: again", file=sys.stderr)
        rows += these
    made = table(rows)
    print(made)
    head, _, kept = PAGE.read_text(encoding="utf-8").partition(MARK)
    if arguments.write:
        PAGE.write_text(f"{head}{MARK}{made}", encoding="utf-8")
    if arguments.check and made != kept:
        print(f"{PAGE} has another table", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

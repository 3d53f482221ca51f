"""Speed beside other packages, in one command: `python -m benchmarks.speed`.

A suite (`benchmarks.speed.suites`) measures contenders in turns and returns sections of plain data; `report` and
`figure` write them down. A package that is not installed is named as missing. `pip install 'kinreach[bench]'` brings
the peers.
"""

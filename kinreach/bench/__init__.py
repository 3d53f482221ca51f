"""Speed beside other packages, in one command: `python -m kinreach.bench`.

A suite (`kinreach.bench.suites`) measures contenders in turns and returns sections of plain data; `report` and `figure`
write them down. A package that is not installed is named as missing. `pip install 'kinreach[bench]'` brings the peers.
"""

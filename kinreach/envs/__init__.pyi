from ._single import RecordMotion as RecordMotion
from ._tabletop import TabletopState as TabletopState
from ._tabletop import TabletopTask as TabletopTask
from ._tabletop import register_tabletop as register_tabletop

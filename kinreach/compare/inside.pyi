from ._methods.resolve import resolve_methods as resolve_methods
from ._options import OptionFlags as OptionFlags
from ._task import all_tasks as all_tasks
from ._task import arm_in as arm_in

from ._methods import resolve_methods as resolve_methods
from ._options import add_flags as add_flags
from ._options import flags_of as flags_of
from ._options import given_options as given_options
from ._task import POLICY as POLICY
from ._task import arm_in as arm_in
from ._task import get_task as get_task
from ._task import task_names as task_names

from ._maps import view_from_the_robot as view_from_the_robot
from ._methods import METHOD_COLOURS as METHOD_COLOURS
from ._methods import method_colours as method_colours
from ._motion import draw_motion as draw_motion
from ._style import name_label as name_label
from ._style import plain_ticks as plain_ticks
from ._style import text_colour as text_colour
from ._style import verbatim as verbatim

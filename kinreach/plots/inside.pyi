from ._colours import method_colours as method_colours
from ._maps import view_from_the_robot as view_from_the_robot
from ._style import name_label as name_label
from ._style import plain_ticks as plain_ticks
from ._style import text_colour as text_colour
from ._workspace import draw_workspace as draw_workspace

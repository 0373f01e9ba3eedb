"""What is said where a tool is missing that an export is verified with."""

from ge_torchrl.errors import UserError

INSTALL = 'expected it installed: pip install -c constraints.txt -e ".[export]"'
UNVERIFIED = "or type --unverified"


class MissingToolError(UserError):
    """What runs a format is not on this machine."""

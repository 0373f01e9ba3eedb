"""`export`: a controller in another language or file format."""

import argparse
import sys
from pathlib import Path

from ge_torchrl.cli.parser import Parser, add_controller
from ge_torchrl.cli.statuses import OK
from ge_torchrl.errors import UserError

TO = ("python", "c", "onnx", "sklearn", "json", "dot", "mermaid", "svg", "text", "latex", "st")
"""The formats, in the order of `exports.formats`, which is not loaded to complete a word."""
_FORMATS = """\
formats:
  python   a function without imports
  c        a C99 function without allocation, for a microcontroller
  st       a function block in Structured Text (IEC 61131-3), for a PLC
  onnx     a model for ONNX runtimes; needs --out
  sklearn  a Python file that makes a scikit-learn tree
  json     the tree's own file
  svg, dot, mermaid, latex, text   drawings

Before anything is written, the export is run on 10,000 observations, a quarter of them on thresholds or one float32
beside, and has to answer each as the tree does.

exit status: 0 written; 2 the tree, the name or this machine does not allow it, told in one line; 1 the export
answers otherwise than the tree, and nothing is written.
"""


def export(arguments: list[str]) -> int:
    """Write a controller in another format, as `export --help` tells; return the exit status."""
    options = _parser().parse_args(arguments)

    from ge_torchrl.artefacts.controllers import named_controller
    from ge_torchrl.artefacts.texts import make_folder_of, write_whole
    from ge_torchrl.exports.exporting import exported
    from ge_torchrl.exports.formats import FORMATS
    from ge_torchrl.exports.observations import N_OBSERVATIONS

    if options.out is None and not FORMATS[options.to].is_text:
        raise UserError(f"--to {options.to} is no text for a terminal, so expected --out FILE")
    controller = named_controller(options.path, options.nodes)
    content = exported(controller, options.to, options.name, verify=not options.unverified)
    if options.out is None:
        _show(content, is_drawing=options.to == "text")
        return OK
    make_folder_of(options.out)
    write_whole(options.out, lambda beside: beside.write_bytes(content))
    how = (
        ", unverified"
        if options.unverified
        else f": it answers {N_OBSERVATIONS:,} observations as the tree does"
    )
    print(f"wrote {options.out}{how}")
    return OK


def _show(content: bytes, *, is_drawing: bool) -> None:
    """Print a text; what is no drawing with lines keeps its bytes in a pipe, since it will be a file."""
    if is_drawing or sys.stdout.isatty():
        print(content.decode(), end="")
        return
    sys.stdout.flush()
    sys.stdout.buffer.write(content)


def _parser() -> Parser:
    parser = Parser(
        prog="ge-torchrl export",
        description="Write a controller as a program, a model, a file or a drawing.",
        epilog=_FORMATS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_controller(parser, "CONTROLLER")
    parser.add_argument("--to", metavar="FORMAT", required=True, choices=TO, help="one of those below")
    parser.add_argument("--out", metavar="FILE", type=Path, help="default: standard output")
    parser.add_argument(
        "--name",
        default="controller",
        help="of the function, the function block or the graph; default: controller",
    )
    parser.add_argument(
        "--unverified",
        action="store_true",
        help="write it untried, such as C where there is no compiler",
    )
    return parser

"""The thesis' comparison: its printed numbers beside ours, and its question whether refinement saves generations."""

"""An episode to watch: the environment's picture, and the rule beside it with the path that decides lit."""

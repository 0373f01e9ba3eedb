"""The names that make a tree readable: what its numbers of features and actions mean."""

from dataclasses import dataclass

from ge_torchrl.errors import InvalidTreeError


@dataclass(frozen=True)
class TreeLabels:
    """Names of an environment's features and actions.

    Attributes:
        environment: Gymnasium id, such as `CartPole-v1`.
        features: [D] names of the observation's entries.
        units: [D] their units, an empty string where there is none.
        actions: [A] names of the actions.

    Raises:
        InvalidTreeError: Features and units differ in number, or there is no feature or action.
    """

    environment: str
    features: tuple[str, ...]
    units: tuple[str, ...]
    actions: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.features) != len(self.units):
            raise InvalidTreeError(
                f"every feature needs a unit (an empty string for none); "
                f"{self.environment} has {len(self.features)} features and {len(self.units)} units"
            )
        if not self.features or not self.actions:
            raise InvalidTreeError(f"{self.environment} needs at least one feature and one action")

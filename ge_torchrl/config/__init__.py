"""The settings of a run: frozen records, one a section, whose types and ranges are declared on their fields."""

from ge_torchrl.config.archive import ArchiveConfig
from ge_torchrl.config.environment import EnvironmentConfig
from ge_torchrl.config.keys import check_choice, check_group, without_gone
from ge_torchrl.config.record import MAPPINGS, Config, check_key, similar_keys, template
from ge_torchrl.config.refinement import PolishConfig, PPOConfig, RefinerConfig, ScheduleConfig
from ge_torchrl.config.sections import EvaluationConfig, GEConfig, GrammarConfig
from ge_torchrl.config.starts import StartsConfig

__all__ = [
    "MAPPINGS",
    "ArchiveConfig",
    "Config",
    "EnvironmentConfig",
    "EvaluationConfig",
    "GEConfig",
    "GrammarConfig",
    "PPOConfig",
    "PolishConfig",
    "RefinerConfig",
    "ScheduleConfig",
    "StartsConfig",
    "check_choice",
    "check_group",
    "check_key",
    "similar_keys",
    "template",
    "without_gone",
]

"""Settings of a process: flags before environment before a file that one of them names."""

from pathlib import Path

from pydantic_settings import (
    BaseSettings,
    InitSettingsSource,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
)

from slowtime_services.documents.bounds import DocumentError
from slowtime_services.documents.document_files import read_settings_file


class ProcessSettings(BaseSettings):
    """Frozen, with nothing unknown in it; a process adds its fields and its `env_prefix`."""

    model_config = SettingsConfigDict(
        frozen=True,
        extra="forbid",
        env_nested_delimiter="__",
    )

    config: Path | None = None
    """TOML or JSON file to take settings from."""

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Ask flags before environment before file."""
        path = init_settings().get("config") or env_settings().get("config")
        if path is None:
            return init_settings, env_settings
        return init_settings, env_settings, _file_source(settings_cls, Path(path))


def _file_source(settings: type[BaseSettings], path: Path) -> PydanticBaseSettingsSource:
    if not path.is_file():
        raise FileNotFoundError(f"There is no settings file {path}. Give an existing --config.")
    if path.suffix not in (".toml", ".json"):
        raise ValueError(f"{path.name} is not a valid settings file. Allowed: .toml and .json.")
    content = read_settings_file(path)
    if not isinstance(content, dict):
        raise DocumentError("It holds no table of settings. Give NAME = VALUE, or an object.")
    return InitSettingsSource(settings, content)

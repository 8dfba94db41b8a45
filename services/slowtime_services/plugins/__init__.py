"""Installed parts of other distributions in; sources, readers, effects and the like out."""

from .discovery import GROUPS, Plugin, PluginError, find, plugins, said

__all__ = ["GROUPS", "Plugin", "PluginError", "find", "plugins", "said"]

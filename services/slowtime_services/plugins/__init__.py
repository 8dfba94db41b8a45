"""Installed parts of other distributions in; sources, readers, effects and the like out."""

from .discovery import GROUPS, Plugin, PluginError, exception_text, find, plugins

__all__ = ["GROUPS", "Plugin", "PluginError", "exception_text", "find", "plugins"]

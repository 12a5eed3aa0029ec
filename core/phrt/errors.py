"""What can go wrong, and who is told how.

Policy: a user's mistake is an `InputError` whose message names the place, what was given and what is allowed; the
command line prints it without a traceback and exits with 2. Everything else is our fault: it raises loudly and exits
with 1. A plugin's fault is contained where it happens and reported once, by name, as a `PhrtWarning`.
"""

from __future__ import annotations


class PhrtError(Exception):
    """Base of every error PHRT raises on purpose."""


class InputError(PhrtError):
    """Something the user gave cannot be used. The message says where, what was given and what is allowed."""


class SceneError(InputError):
    """A scene descriptor is wrong: unknown key, wrong type, dangling reference, cycle."""


class AssetError(InputError):
    """A file a scene needs is missing, broken, outside the asset roots, or asks for what PHRT does not support."""


class OptionError(InputError):
    """An option, a size, a budget or a `-D key=value` is not one of the allowed ones."""


class ProfileError(InputError):
    """A profile cannot be read, is of another version, or of another scene."""


class PluginError(InputError):
    """A plugin that was asked for by name is unknown, unavailable or broken."""


class PhrtWarning(UserWarning):
    """Something was left out or replaced, and the picture shows it. Never raised for what is merely slow."""


def did_you_mean(given: str, allowed: list[str]) -> str:
    """`given`, corrected to the nearest of `allowed`, as the tail of an error message; empty when nothing is near."""
    import difflib

    near = difflib.get_close_matches(given, allowed, n=1)
    return f" Did you mean '{near[0]}'?" if near else ""

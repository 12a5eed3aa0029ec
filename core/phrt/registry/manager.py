"""The registry: which plugins there are, and making one by name.

Built-in plugins come from `DEFAULT_PLUGINS`, others from the entry points of group `phrt`, from `register` (notebooks)
and from `--plugin`. Each is loaded on its own, so that a broken one costs a warning and not the program. The order of
registration decides nothing: two packages that claim one name both lose it, and a built-in name cannot be taken.
"""

from __future__ import annotations

import importlib
import threading
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.metadata import EntryPoint, entry_points, version
from typing import Any, Literal

import pluggy

from phrt.errors import PhrtError, PhrtWarning, PluginError, did_you_mean
from phrt.registry import hookspecs
from phrt.registry.descriptors import (
    OLDEST_API_VERSION,
    PLUGIN_API_VERSION,
    CommandPlugin,
    EffectPlugin,
    GBufferPlugin,
    HeuristicPlugin,
    LoaderPlugin,
    MetricPlugin,
    Plugin,
    TracerPlugin,
)
from phrt.registry.fields import check_fields
from phrt.registry.options import validate_options
from phrt.registry.origins import note_origin

DEFAULT_PLUGINS = ("phrt_backends.plugin", "phrt_heuristics.plugin", "phrt_plugins.plugin")
ENTRY_POINT_GROUP = "phrt"

KINDS: dict[str, type[Plugin]] = {
    "gbuffer": GBufferPlugin,
    "tracer": TracerPlugin,
    "effect": EffectPlugin,
    "heuristic": HeuristicPlugin,
    "loader": LoaderPlugin,
    "metric": MetricPlugin,
    "command": CommandPlugin,
}
"""Every kind of plugin and its descriptor, in the order they are listed. The hook of kind X is `phrt_Xs`."""

CORE_COMMANDS = ("render", "analyze", "explain", "plugins", "new", "doctor", "schema")
"""What `phrt` can do without any plugin. These names cannot be taken."""

Origin = Literal["built-in", "installed", "registered"]


@dataclass(frozen=True)
class RegisteredPlugin:
    """A descriptor and who brought it. owner: distribution or the name given to `register`; version: the owner's."""

    plugin: Plugin
    kind: str
    owner: str
    origin: Origin
    version: str

    @property
    def name(self) -> str:
        return self.plugin.name

    @property
    def source(self) -> str:
        """Who brought it, for tables and messages: "built-in" or "package version"."""
        return "built-in" if self.origin == "built-in" else f"{self.owner} {self.version}".strip()

    def unavailable_reason(self) -> str | None:
        """None, or why it cannot run here and what to install. A check that fails counts as unavailable."""
        try:
            reason: object = self.plugin.unavailable_reason()
        except (Exception, SystemExit) as error:
            return f"its availability check failed: {describe(error)}"
        if reason is None or isinstance(reason, str):
            return reason
        return f"its availability check failed: it returned {reason!r:.80}, not None or a text"


@dataclass(frozen=True)
class BrokenPlugin:
    """Something that could not be loaded, wholly or in part. names: what asking for it may be called."""

    owner: str
    cause: str
    names: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"plugin '{self.owner}' was left out: {self.cause}"


class Registry:
    """All plugins of the process. Use `get_registry()`; a fresh one is for tests."""

    def __init__(self) -> None:
        self._manager = pluggy.PluginManager(hookspecs.PROJECT)
        self._manager.add_hookspecs(hookspecs)
        self._plugins: dict[tuple[str, str], RegisteredPlugin] = {}
        self._clashes: dict[tuple[str, str], list[str]] = {}
        self.broken: list[BrokenPlugin] = []

    # Asking

    def plugins(self, kind: str | None = None) -> list[RegisteredPlugin]:
        """Every plugin, of one kind or of all: by kind, then by an effect's `order`, then by name."""
        kinds = list(KINDS)
        chosen = [entry for entry in self._plugins.values() if kind is None or entry.kind == check_kind(kind)]
        return sorted(chosen, key=lambda e: (kinds.index(e.kind), getattr(e.plugin, "order", 0), e.name))

    def names(self, kind: str) -> list[str]:
        return [entry.name for entry in self.plugins(kind)]

    def find(self, kind: str, name: str) -> RegisteredPlugin:
        """The plugin of that name with its owner. Raises PluginError when it is unknown, refused or broken."""
        entry = self._plugins.get((check_kind(kind), name))
        if entry is None:
            raise PluginError(self._why_not(kind, name))
        return entry

    def get(self, kind: str, name: str) -> Plugin:
        """The descriptor of that name. Raises PluginError as `find` does."""
        return self.find(kind, name).plugin

    def why_lost(self, name: str) -> str | None:
        """Why nothing is called `name` although somebody brought it; None where nobody did."""
        for kind, clashing in self._clashes:
            if clashing == name:
                return self._why_not(kind, name)
        return next((f"'{name}' cannot be used: {each}" for each in self.broken if name in each.names), None)

    def check_whole(self) -> None:
        """Raises PluginError where a plugin was left out, whether anybody asked for it or not."""
        if self.broken:
            raise PluginError("; ".join(str(each) for each in self.broken))

    def loader_for(self, suffix: str) -> LoaderPlugin | None:
        """The loader of files that end in `suffix` (with the dot, any case), or None. What a built-in one reads stays its own.

        Raises PluginError where several others claim such files.
        """
        claims = [e for e in self.plugins("loader") if suffix.lower() in getattr(e.plugin, "suffixes", ())]
        claims = [e for e in claims if e.origin == "built-in"] or claims
        if len(claims) > 1:
            named = " and ".join(f"'{e.name}' of '{e.owner}'" for e in claims)
            raise PluginError(f"'{suffix}' files are claimed by the loaders {named}; name one of them by `loader:`")
        found = claims[0].plugin if claims else None
        return found if isinstance(found, LoaderPlugin) else None

    def create(self, kind: str, name: str, options: Mapping[str, object] | None = None, **dependencies: object) -> Any:
        """Make it: options are checked, the factory imported and called with them and `dependencies`.

        Raises OptionError for a wrong option, PluginError when it is unknown, unavailable here or broken.
        """
        entry = self.find(kind, name)
        title = f"{kind} '{name}'"
        try:
            checked = validate_options(title, entry.plugin.options, options or {})
        except PhrtError:
            raise
        except Exception as error:
            raise PluginError(f"{title} of {entry.source} cannot check its options: {describe(error)}") from error
        if reason := entry.unavailable_reason():
            raise PluginError(f"{title} is not available here: {reason}")
        factory = import_factory(title, entry)
        try:
            made = factory(checked, **dependencies)
        except PhrtError:
            raise
        except (Exception, SystemExit) as error:
            raise PluginError(f"{title} of {entry.source} could not be started: {describe(error)}") from error
        note_origin(made, entry)
        return made

    # Adding

    def register(self, plugin: object, owner: str | None = None, version: str = "") -> None:
        """Add a module, an object with hook methods, or a single descriptor, from a notebook or `--plugin`.

        The same owner registering again replaces all that it registered before; a single descriptor without an owner replaces the
        one of its name from the same module. Raises PluginError when it is refused, and then nothing has changed.
        """
        alone = isinstance(plugin, Plugin) and owner is None
        owner = owner or default_owner(plugin)
        version = version or str(getattr(plugin, "__version__", ""))
        source = single_descriptor(plugin) if isinstance(plugin, Plugin) else plugin
        try:
            offered = self._offered(source, owner)
        except PhrtError:
            raise
        except (Exception, SystemExit) as error:
            raise PluginError(f"'{owner}' is refused: its hook failed: {describe(error)}") from error
        entries = {(e.kind, e.name): e for e in checked_entries(offered, owner, "registered", version)}
        replaced = [key for key in self._registered_by(owner) if not alone or key in entries]
        for key, entry in entries.items():
            clash = self._plugins.get(key)
            if clash is not None and key not in replaced:
                raise PluginError(
                    f"{entry.kind} '{entry.name}' of '{owner}' is refused: {clash.source} "
                    f"('{clash.owner}') already has that name. Choose another name."
                )
        for key in replaced:
            del self._plugins[key]
        self._plugins.update(entries)

    def load_defaults(self, modules: Iterable[str] = DEFAULT_PLUGINS) -> None:
        """Add the built-in plugin modules, each on its own."""
        for module in modules:
            self._load_contained(module, "built-in", phrt_version(), partial(importlib.import_module, module))

    def load_entry_points(self, found: Iterable[EntryPoint] | None = None) -> None:
        """Add what installed packages offer under the entry point group `phrt`, each on its own, sorted by package."""
        points = entry_points(group=ENTRY_POINT_GROUP) if found is None else found
        for point in sorted(points, key=lambda p: (p.dist.name if p.dist else "", p.name, p.value)):
            owner = point.dist.name if point.dist else point.name
            self._load_contained(owner, "installed", point.dist.version if point.dist else "", point.load, point.name)

    # Inside

    def _load_contained(
        self, owner: str, origin: Origin, version: str, load: Callable[[], object], name: str | None = None
    ) -> None:
        """Load one plugin; whatever it does wrong ends in `broken` and one warning."""
        names = list(filter(None, (name, owner)))
        try:
            offered = self._offered(load(), owner)
            names += [str(getattr(descriptor, "name", "")) for _, descriptor in offered]
            entries = checked_entries(offered, owner, origin, version)
        except (Exception, SystemExit) as error:
            cause = str(error) if isinstance(error, PhrtError) else describe(error)
            self._report(BrokenPlugin(owner, cause, tuple(names)))
            return
        for entry in entries:
            self._add(entry)

    def _add(self, entry: RegisteredPlugin) -> None:
        """Add an entry, or settle a clash of names: a built-in stays, two others both go."""
        key = (entry.kind, entry.name)
        owner = self._plugins[key].owner if key in self._plugins else None
        if owner is None and key not in self._clashes:
            self._plugins[key] = entry
            return
        if owner is not None and self._plugins[key].origin == "built-in":
            cause = f"{entry.kind} '{entry.name}' of '{entry.owner}' is refused: '{owner}' already has that name"
            self._report(BrokenPlugin(entry.owner, cause))
            return
        self._plugins.pop(key, None)
        owners = self._clashes.setdefault(key, [owner] if owner else [])
        owners.append(entry.owner)
        named = " and ".join(f"'{each}'" for each in owners)
        cause = f"{entry.kind} '{entry.name}' is refused: {named} both claim that name. Uninstall one"
        self._report(BrokenPlugin(entry.owner, cause))

    def _offered(self, source: object, owner: str) -> list[tuple[str, object]]:
        """What the hooks of one plugin return, each with its kind. Raises PluginError, or whatever the hooks raise."""
        check_hook_names(source)
        name = f"{owner}#{id(source)}"
        try:
            self._manager.register(source, name=name)
            self._manager.check_pending()
            return [
                (kind, descriptor)
                for kind in KINDS
                for implementation in getattr(self._manager.hook, hook_name(kind)).get_hookimpls()
                if implementation.plugin is source
                for descriptor in implementation.function()
            ]
        finally:
            # Descriptors are all that is wanted of it.
            if self._manager.has_plugin(name):
                self._manager.unregister(name=name)

    def _registered_by(self, owner: str) -> list[tuple[str, str]]:
        """Kinds and names of what `owner` registered."""
        return [key for key, e in self._plugins.items() if e.owner == owner and e.origin == "registered"]

    def _forget(self, owner: str) -> None:
        """Take back what `owner` registered before."""
        for key in self._registered_by(owner):
            del self._plugins[key]

    def _report(self, broken: BrokenPlugin) -> None:
        self.broken.append(broken)
        warnings.warn(PhrtWarning(str(broken)), stacklevel=4)

    def _why_not(self, kind: str, name: str) -> str:
        """Why there is no plugin of that name."""
        if owners := self._clashes.get((kind, name)):
            named = " and ".join(f"'{owner}'" for owner in owners)
            return f"{kind} '{name}' cannot be used: {named} both claim that name. Uninstall one."
        for broken in self.broken:
            if name in broken.names:
                return f"{kind} '{name}' cannot be used: plugin '{broken.owner}' is broken: {broken.cause}"
        known = self.names(kind)
        listed = ", ".join(known) if known else "none is installed"
        message = f"there is no {kind} '{name}'. Known: {listed}.{did_you_mean(name, known)}"
        if self.broken:
            message += " It may belong to a plugin that is broken: " + "; ".join(str(each) for each in self.broken)
        return message


_registry: Registry | None = None
_lock = threading.RLock()


def get_registry() -> Registry:
    """The registry of this process, filled on first use."""
    global _registry
    with _lock:
        if _registry is None:
            registry = Registry()
            registry.load_defaults()
            registry.load_entry_points()
            _registry = registry
        return _registry


def register(plugin: object, owner: str | None = None) -> None:
    """Add a plugin to this process: a module, an object with hook methods, or one descriptor.

    Raises PluginError when it is refused; the message says why.
    """
    get_registry().register(plugin, owner)


def hook_name(kind: str) -> str:
    return f"phrt_{kind}s"


def check_kind(kind: str) -> str:
    """`kind`, when there is such a kind; PluginError otherwise."""
    if kind not in KINDS:
        raise PluginError(
            f"there is no kind of plugin '{kind}'. Known: {', '.join(KINDS)}.{did_you_mean(kind, [*KINDS])}"
        )
    return kind


def describe(error: BaseException) -> str:
    """An exception in one line: its type and what it says."""
    return f"{type(error).__name__}: {error}".rstrip(": ").replace("\n", " ")


def phrt_version() -> str:
    """Version of the installed distribution."""
    return version("phrt")


def default_owner(plugin: object) -> str:
    """A name for whoever registered `plugin` without giving one."""
    if isinstance(plugin, Plugin):
        return str(plugin.factory).partition(":")[0]
    return str(getattr(plugin, "__name__", type(plugin).__name__))


def single_descriptor(descriptor: Plugin) -> object:
    """A plugin object that hands over just `descriptor`."""
    kind = next((kind for kind, expected in KINDS.items() if isinstance(descriptor, expected)), None)
    if kind is None:
        raise PluginError(f"'{descriptor.name}' is a bare Plugin; use {', '.join(c.__name__ for c in KINDS.values())}")
    hook = hookspecs.hookimpl(lambda: [descriptor])
    return type(f"Plugin_{descriptor.name}", (), {hook_name(kind): staticmethod(hook)})()


def check_hook_names(source: object) -> None:
    """PluginError where `source` has no hook, a misspelt one, or one that is not marked."""
    known = [hook_name(kind) for kind in KINDS]
    mark = f"{hookspecs.PROJECT}_impl"
    marked = [name for name in dir(source) if getattr(getattr(source, name, None), mark, None) is not None]
    for name in marked:
        if name not in known:
            raise PluginError(
                f"it implements an unknown hook '{name}'. Known: {', '.join(known)}.{did_you_mean(name, known)}"
            )
    for name in set(known) - set(marked):
        if callable(getattr(source, name, None)):
            raise PluginError(
                f"its function '{name}' is not marked with @hookimpl (from phrt.registry import hookimpl)"
            )
    if not marked:
        raise PluginError(f"it implements none of the hooks {', '.join(known)}")


def checked_entries(
    offered: Iterable[tuple[str, object]], owner: str, origin: Origin, version: str
) -> list[RegisteredPlugin]:
    """What a plugin offers, as entries. Raises PluginError for a descriptor that cannot be used, or a name that is there twice."""
    entries = [RegisteredPlugin(checked_descriptor(each, kind), kind, owner, origin, version) for kind, each in offered]
    for number, entry in enumerate(entries):
        if any((entry.kind, entry.name) == (e.kind, e.name) for e in entries[:number]):
            raise PluginError(f"it brings two of {entry.kind} '{entry.name}'")
    return entries


def checked_descriptor(descriptor: object, kind: str) -> Plugin:
    """`descriptor`, when it is a usable one of `kind`; PluginError otherwise."""
    expected = KINDS[kind]
    if not isinstance(descriptor, expected):
        raise PluginError(f"{hook_name(kind)} returned {descriptor!r}, expected a list of {expected.__name__}")
    title = f"{kind} '{descriptor.name}'"
    check_api_version(title, descriptor.api_version)
    check_fields(title, descriptor)
    module, colon, name = str(descriptor.factory).partition(":")
    if not (descriptor.name and module and colon and name and isinstance(descriptor.factory, str)):
        raise PluginError(f"{title} needs a name and a factory 'module:Class' as text, got '{descriptor.factory}'")
    if kind == "command" and descriptor.name in CORE_COMMANDS:
        raise PluginError(f"{title} is refused: `phrt {descriptor.name}` is PHRT's own. Choose another name")
    for suffix in getattr(descriptor, "suffixes", ()):
        if suffix != suffix.lower() or not suffix.startswith("."):
            raise PluginError(f"{title} reads '{suffix}' files; a suffix is lower case and begins with a dot")
    return descriptor


def check_api_version(title: str, version: object) -> None:
    """Raises PluginError where a plugin of API `version` cannot be used here, and says what can be done."""
    here = f"this is PHRT {phrt_version()} with plugin API {PLUGIN_API_VERSION}"
    if not isinstance(version, int) or isinstance(version, bool):
        raise PluginError(f"{title} has api_version {version!r}; it must be a whole number, and {here}")
    if version > PLUGIN_API_VERSION:
        raise PluginError(f"{title} needs plugin API {version}, and {here}. Install a newer PHRT")
    if version < OLDEST_API_VERSION:
        raise PluginError(
            f"{title} is written for plugin API {version}; {here}, which takes {OLDEST_API_VERSION} and newer. "
            "Install a newer version of the plugin"
        )


def import_factory(title: str, entry: RegisteredPlugin) -> Callable[..., object]:
    """The factory of `entry`. Raises PluginError with the cause when it cannot be imported."""
    module_name, _, attribute = entry.plugin.factory.partition(":")
    try:
        target: object = importlib.import_module(module_name)
        for part in attribute.split("."):
            target = getattr(target, part)
    except (Exception, SystemExit) as error:
        message = f"{title} of {entry.source} is broken: '{entry.plugin.factory}' cannot be imported: {describe(error)}"
        raise PluginError(message) from error
    if not callable(target):
        raise PluginError(f"{title} of {entry.source} is broken: '{entry.plugin.factory}' is not callable")
    return target

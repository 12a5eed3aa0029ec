"""The glTF 2.0 loader: .gltf and .glb.

What it reads, and what not, is listed in docs/loaders/gltf.md; its options are `GltfOptions`. In a scene descriptor:

    model:
      asset: sponza.glb
      scene: 0

Source: Khronos Group, glTF 2.0 specification, version 2.0.1, and the KHR and EXT extensions named in `gltf_extras`.

The story of a file: container (GLB or text) -> JSON -> buffers and accessors, all checked -> materials and images ->
meshes -> the nodes of one scene -> tracks. Every value is checked before it is used, so that a broken or hostile file
ends in an AssetError that names the place.
"""

from __future__ import annotations

from pathlib import Path

from phrt.errors import AssetError
from phrt.interfaces.loader import LoadContext, Loader
from phrt.model import Model
from phrt_plugins.loaders.gltf_accessors import Accessors
from phrt_plugins.loaders.gltf_animations import AnimationReader
from phrt_plugins.loaders.gltf_container import read_container
from phrt_plugins.loaders.gltf_extras import check_extensions, check_version, read_cameras, read_lights
from phrt_plugins.loaders.gltf_images import Images
from phrt_plugins.loaders.gltf_json import Document, parse_json
from phrt_plugins.loaders.gltf_materials import read_materials
from phrt_plugins.loaders.gltf_meshes import MeshLibrary
from phrt_plugins.loaders.gltf_nodes import NodeBuilder, read_hierarchy, scene_roots
from phrt_plugins.loaders.gltf_skins import Skins
from phrt_plugins.loaders.options import GltfOptions


class GltfLoader(Loader):
    """Reads glTF 2.0 files."""

    def __init__(self, options: GltfOptions) -> None:
        self.options = options

    def load(self, path: Path, context: LoadContext) -> Model:
        """The model in `path`. Raises AssetError naming the file, the place in it and the reason."""
        try:
            return self._load(path, context)
        except AssetError as error:
            message = str(error)
            raise AssetError(message if message.startswith(f"{path}:") else f"{path}: {message}") from None
        except MemoryError:
            raise AssetError(f"{path}: needs more memory than there is") from None

    def _load(self, path: Path, context: LoadContext) -> Model:
        container = read_container(path, context.warn)
        document = Document(parse_json(container.json, "JSON"), context.warn)
        check_version(document)
        check_extensions(document)
        accessors = Accessors(document, container.binary, container.is_glb, context)
        images = Images(document, accessors, context, self.options.max_texture_size)
        materials = read_materials(document, images)
        library = MeshLibrary(document, accessors, materials)
        accessors.check_all()

        # The nodes of the chosen scene, and the meshes at their rest pose.
        hierarchy = read_hierarchy(document)
        skins = Skins(document, accessors, hierarchy.world())
        lights, cameras = read_lights(document), read_cameras(document)
        builder = NodeBuilder(document, accessors, hierarchy, library, skins)
        builder.build(scene_roots(document, hierarchy, self.options.scene))
        if not any(node.meshes for node in builder.nodes):
            document.warn("has nothing to draw")
        animations = AnimationReader(document, accessors, builder.model_node, builder.skin_joints)
        return Model(
            nodes=builder.nodes,
            meshes=library.meshes,
            materials=materials,
            images=images.decode(),
            lights=lights,
            cameras=cameras,
            tracks=animations.read(self.options.animation),
        )

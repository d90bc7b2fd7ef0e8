"""Cut-outs of glTF materials: ``alphaMode`` MASK with the alpha of its base colour.

Section numbers are those of the glTF 2.0 specification [Khronos2021]_; what changes the picture and
is not honoured here is refused.

References
----------
.. [Khronos2021] The Khronos 3D Formats Working Group: glTF 2.0 Specification, version 2.0.1, 2021.
.. [KHR_texture_transform] The same: KHR_texture_transform, extension of glTF 2.0.
"""

import io
import math

import numpy as np

from .spaces import frozen

__all__ = ["MaterialReader", "has_mask"]

REPEAT = 10497
_TRANSFORM = "KHR_texture_transform"


def has_mask(document):
    """Whether a material of the file is cut out."""
    return any(material.get("alphaMode") == "MASK" for material in document.items("materials"))


class MaterialReader:
    """Reads the cut-outs of primitives; every image is decoded once.

    Parameters
    ----------
    document : csm.gltf.Document
    """

    def __init__(self, document):
        self._document = document
        self._alphas = {}  # by image and factor: meshes share their arrays

    def cutout(self, primitive):
        """Read what `csm.Mesh` takes for a primitive.

        Parameters
        ----------
        primitive : dict

        Returns
        -------
        cutout : dict
            ``uv``, ``alpha`` and ``alpha_cutoff``; empty if the material is not MASK: OPAQUE, and
            BLEND, which casts a whole shadow and is seen as a whole surface.

        Raises
        ------
        ValueError
            If the file contradicts itself, or the cut-out depends on what csm does not read.
        OSError
            If an image beside the file cannot be read.
        """
        if "material" not in primitive:
            return {}
        number = primitive["material"]
        material = self._document.item("materials", number)
        if material.get("alphaMode", "OPAQUE") != "MASK":
            return {}
        try:
            return self._masked(primitive, material)
        except (AttributeError, IndexError, KeyError, TypeError) as error:
            raise ValueError(f"material {number} is malformed ({error!r})") from error
        except ValueError as error:
            raise ValueError(f"material {number}: {error}") from error

    def _masked(self, primitive, material):
        if "KHR_materials_pbrSpecularGlossiness" in material.get("extensions", {}):
            raise ValueError("its cut-out is in KHR_materials_pbrSpecularGlossiness, not read")
        attributes = primitive["attributes"]
        if "COLOR_0" in attributes:
            colours = self._document.accessor(attributes["COLOR_0"])
            # 3.9.2: vertex colours multiply the base colour, alpha too
            largest = 1.0 if colours.dtype.kind == "f" else np.inf
            if colours.ndim == 2 and colours.shape[1] == 4 and (colours[:, 3] < largest).any():
                raise ValueError("a cut-out whose vertex colours have an alpha is not read")
        base = material.get("pbrMetallicRoughness", {})
        factor = float(base.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))[3])
        cutoff = float(material.get("alphaCutoff", 0.5))
        count = self._document.item("accessors", attributes["POSITION"])["count"]
        texture = base.get("baseColorTexture")
        if texture is None:
            if factor >= cutoff:
                return {}
            return {
                "uv": np.zeros((count, 2)),
                "alpha": np.zeros((1, 1), np.uint8),
                "alpha_cutoff": 0.5,
            }
        uv = self._coordinates(attributes, texture)
        if len(uv) != count:
            raise ValueError(f"{len(uv)} texture coordinates for {count} positions")
        item = self._document.item("textures", texture["index"])
        self._refuse_wrap(item, uv)
        return {"uv": uv, "alpha": self._alpha(item, factor), "alpha_cutoff": cutoff}

    def _coordinates(self, attributes, texture):
        transform = texture.get("extensions", {}).get(_TRANSFORM, {})
        name = f"TEXCOORD_{transform.get('texCoord', texture.get('texCoord', 0))}"
        if name not in attributes:
            raise ValueError(f"its texture needs {name}, which a primitive lacks")
        uv = self._document.accessor(attributes[name])
        if uv.dtype.kind != "f" or uv.ndim != 2 or uv.shape[1] != 2:
            raise ValueError(f"{name} must be VEC2 of floats or normalised integers")
        scale = np.array(transform.get("scale", (1.0, 1.0)), np.float64)
        offset = np.array(transform.get("offset", (0.0, 0.0)), np.float64)
        angle = float(transform.get("rotation", 0.0))
        # Counter-clockwise as one sees the image, whose v points down: the extension's example,
        # offset (0, 1), a quarter turn and scale 1/2, then is the lower left quadrant.
        turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        return (uv * scale) @ turn.T + offset if transform else uv

    def _refuse_wrap(self, texture, uv):
        sampler = {}
        if "sampler" in texture:
            sampler = self._document.item("samplers", texture["sampler"])
        for axis, name in enumerate(("wrapS", "wrapT")):
            mode = sampler.get(name, REPEAT)
            low, high = uv[:, axis].min(), uv[:, axis].max()
            # inside the image they are all the same
            if mode != REPEAT and (low < 0.0 or high > 1.0):
                raise ValueError(
                    f"its sampler's {name} is {mode} and coordinates go from {low:g} to {high:g}: "
                    f"beyond 0 to 1 only REPEAT ({REPEAT}) is read"
                )

    def _alpha(self, texture, factor):
        if "source" not in texture:
            names = ", ".join(texture.get("extensions", {})) or "nowhere"
            raise ValueError(f"its image is in {names}, which csm does not read")
        key = (texture["source"], factor)
        if key not in self._alphas:
            alpha = _decoded_alpha(self._image_bytes(texture["source"]))
            if factor != 1.0:
                alpha = np.clip(alpha * (factor / 255.0), 0.0, 1.0).astype(np.float32)
            self._alphas[key] = frozen(alpha)
        return self._alphas[key]

    def _image_bytes(self, number):
        image = self._document.item("images", number)
        if "bufferView" in image:
            return self._document.view_bytes(image["bufferView"])
        return self._document.read(image["uri"])


def _decoded_alpha(data):
    """Alpha of an image file, (h, w) uint8, owning its data; 255 without an alpha channel."""
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError(
            "cut-outs of glTF files need pillow: pip install cascaded-shadow-maps[mesh]"
        ) from error
    try:
        with Image.open(io.BytesIO(data)) as image:
            return np.array(image.convert("RGBA").getchannel("A"), np.uint8)
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"its image cannot be decoded ({error})") from error

"""What csm raises beside ValueError, TypeError, MemoryError and ImportError.

The classes are made by the extension, one set per interpreter, and are the same objects wherever
they are imported from.
"""

from csm._core import ContextError, CsmError, GLError, GLWarning, LimitError, ShaderError

__all__ = ["ContextError", "CsmError", "GLError", "GLWarning", "LimitError", "ShaderError"]

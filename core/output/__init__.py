"""Third floor: what leaves. Pictures, pages, textures and files of a face.

Modules here read a :class:`~bsface.reconstruct.Reconstruction` (or only its
surface) and never change it.
"""

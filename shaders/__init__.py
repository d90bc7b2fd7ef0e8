"""GLSL 450 sources of csm, installed as the package ``csm.shaders``.

A file with a stage suffix is one stage of a pass; a ``.glsl`` file in ``include/`` is a set of
functions that passes include. Every effect is a ``CSM_*`` macro that is always defined, 0 if off.

==================================  ================================================================
``view.vert`` ``view.frag``         what the camera sees: triangle, depth, facing
``receiver_range.comp``             depths of what is seen and faces the sun
``receiver_bounds.comp``            light-space boxes of the same, per cascade
``shadow_map.vert``                 casters into one layer of the shadow maps
``shadow_map.frag``                 depth in warped maps; holes of casters with a cut-out
``shadow_mask.comp``                visibility of the camera's receivers
``shadow_points.comp``              visibility of given world points, looked up in the same maps
``include/``                        spaces and uniform blocks, cascade selection, bias, filters
==================================  ================================================================
"""

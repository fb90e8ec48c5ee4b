"""How the body is shaded: as cheaply as software rendering allows.

VTK's own light loop and its depth offset cost as much as the rest of a link together: the offset
is written for each pixel, which rules out testing depth before shading. Here two fixed lights take
two dot products, and the body is pushed back for each vertex.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv

from viewer.colours import BODY

AMBIENT = 0.25
DIFFUSE = 0.75
HEADLIGHT, FILL = 0.8, 0.35  # strengths of both lights
FILL_FROM = (-0.6, 1.2, 1.0)  # above the left shoulder of who looks: right, up, towards the eye
PUSH = """//VTK::PositionVC::Impl
  // The projection's third row is a times its fourth, but for the constant b: depth is a + b / w
  // with the distance w, so that moving back by d gives a + b / (w + d).
  vec3 awayPB = vec3(MCDCMatrix[0][3], MCDCMatrix[1][3], MCDCMatrix[2][3]);
  vec3 depthPB = vec3(MCDCMatrix[0][2], MCDCMatrix[1][2], MCDCMatrix[2][2]);
  float aPB = dot(depthPB, awayPB) / max(dot(awayPB, awayPB), 1.0e-12);
  float bPB = gl_Position.z - aPB * gl_Position.w;
  gl_Position.z = (aPB + bPB / (gl_Position.w + %.6f)) * gl_Position.w;
"""
# In the place of all of VTK's own lines there: the last of them discards what has no opacity, and
# a shader that may discard has its depth written late.
LIGHT = """  float headSB = max(0.0, normalVCVSOutput.z);
  float fillSB = max(0.0, dot(normalVCVSOutput, vec3(%.6f, %.6f, %.6f)));
  gl_FragData[0] = vec4(ambientColor + (%.6f * headSB + %.6f * fillSB) * diffuseColor, opacity);
"""


FLAT = "  gl_FragData[0] = vec4(ambientColor + diffuseColor, opacity);\n"


def shade(actor: pv.Actor, *, behind: float) -> None:
    """Give an actor the body's look.

    Parameters
    ----------
    actor : pyvista.Actor
        Of a mesh with normals.
    behind : float
        How far behind its place it is drawn [m]: skin that lies on it stays whole.
    """
    actor.prop.color = BODY
    actor.prop.ambient, actor.prop.diffuse, actor.prop.specular = AMBIENT, DIFFUSE, 0.0
    actor.prop.culling = "back"
    shader: Any = actor.GetShaderProperty()
    shader.ClearAllShaderReplacements()
    shader.AddVertexShaderReplacement("//VTK::PositionVC::Impl", True, PUSH % behind, False)
    light(actor)


def light(actor: pv.Actor) -> None:
    """Light an actor that has normals by the two fixed lights."""
    fill = np.array(FILL_FROM) / np.linalg.norm(FILL_FROM)
    _colour_pixels(actor, LIGHT % (*fill, HEADLIGHT, FILL))


def flat(actor: pv.Actor) -> None:
    """Show an opaque actor without lighting in its own colours."""
    _colour_pixels(actor, FLAT)


def _colour_pixels(actor: pv.Actor, code: str) -> None:
    shader: Any = actor.GetShaderProperty()
    shader.AddFragmentShaderReplacement("//VTK::Light::Impl", True, code, False)

"""Pictures of a world: ``make_renderer`` gives what an interface's ``render()`` draws with."""

from aquaquad_envs.rendering.renderer import Renderer, make_renderer

__all__ = ["Renderer", "make_renderer"]

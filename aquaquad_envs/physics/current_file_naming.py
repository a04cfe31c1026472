"""What the variables of a file of ocean currents are called: CF standard names first, then conventions.

Nothing here reads data: names, attributes and dimensions only.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from aquaquad_envs.errors import CurrentFileError

if TYPE_CHECKING:
    import xarray

#: Pairs of names in use (lower case), the usual first; each with how its components point:
#: "east" (east and north), "grid" (along the axes of the grid), "" (not told by the name).
CONVENTIONS = (
    ("uo", "vo", ""), ("water_u", "water_v", "east"), ("u", "v", ""), ("u_sur", "v_sur", ""),
    ("u_eastward", "v_northward", "east"), ("u_sur_eastward", "v_sur_northward", "east"),
    ("uos", "vos", ""), ("ssu", "ssv", ""), ("usurf", "vsurf", ""), ("u_surf", "v_surf", ""),
    ("u_surface", "v_surface", ""), ("surface_u", "surface_v", ""), ("us", "vs", ""),
    ("vozocrtx", "vomecrty", "grid"), ("sozocrtx", "somecrty", "grid"), ("ugos", "vgos", "east"),
    ("uvel", "vvel", ""), ("u_vel", "v_vel", ""), ("u_velocity", "v_velocity", ""),
    ("uvelocity", "vvelocity", ""), ("velocity_u", "velocity_v", ""), ("vel_u", "vel_v", ""),
    ("x_velocity", "y_velocity", "grid"), ("xvel", "yvel", "grid"), ("velx", "vely", ""),
    ("vx", "vy", ""), ("ux", "uy", ""),
    ("u_east", "v_north", "east"), ("east_velocity", "north_velocity", "east"),
    ("east_vel", "north_vel", "east"), ("ve", "vn", "east"), ("eastward", "northward", "east"),
    ("eastward_velocity", "northward_velocity", "east"), ("vel_east", "vel_north", "east"),
    ("eastward_current", "northward_current", "east"), ("current_east", "current_north", "east"),
    ("eastward_sea_water_velocity", "northward_sea_water_velocity", "east"),
    ("surface_eastward_sea_water_velocity", "surface_northward_sea_water_velocity", "east"),
    ("sea_water_x_velocity", "sea_water_y_velocity", "grid"), ("zonal", "meridional", "east"),
    ("zonal_velocity", "meridional_velocity", "east"), ("u_current", "v_current", ""),
    ("current_u", "current_v", ""), ("cur_u", "cur_v", ""), ("ucur", "vcur", ""), ("ucurr", "vcurr", ""),
    ("curu", "curv", ""), ("uc", "vc", ""), ("ucmp", "vcmp", ""), ("u_rho", "v_rho", "grid"),
    ("uogrd", "vogrd", ""), ("u_velo", "v_velo", ""), ("u-vel", "v-vel", ""), ("uu", "vv", ""),
    ("utotal", "vtotal", "east"), ("total_u", "total_v", ""), ("uz", "vz", ""),
    ("ssu_oce", "ssv_oce", ""), ("ocu", "ocv", ""), ("ua", "va", ""), ("ubar", "vbar", ""),
    ("ewct", "nsct", "east"), ("evel", "nvel", "east"),
    ("u_barotropic_velocity", "v_barotropic_velocity", ""), ("ub", "vb", ""),
    ("ubar_eastward", "vbar_northward", "east"),
)  # fmt: skip

_PARTNER = {"eastward": "northward", "x": "y"}
_FOREIGN = {
    "wind", "ice", "stokes", "wave", "stress", "error", "flag", "transport", "increment", "shear",
    "variance", "acceleration", "floor", "bottom", "anomaly", "momentum", "status", "deviation",
}  # fmt: skip
_FOREIGN_TEXT = re.compile(
    r"\b(wind|ice|stokes|stress|error|flag|uncertainty|variance|anomal\w*|status|deviation|transport)\b"
)

_LENGTHS = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "dm": 0.1, "cm": 0.01,
    "centimeter": 0.01, "centimeters": 0.01, "centimetre": 0.01, "centimetres": 0.01, "mm": 0.001,
    "millimeter": 0.001, "millimeters": 0.001, "millimetre": 0.001, "millimetres": 0.001, "km": 1000.0,
    "kilometer": 1000.0, "kilometers": 1000.0, "kilometre": 1000.0, "kilometres": 1000.0, "ft": 0.3048,
    "foot": 0.3048, "feet": 0.3048, "mi": 1609.344, "mile": 1609.344, "miles": 1609.344,
}  # fmt: skip
_TIMES = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "min": 60.0, "minute": 60.0,
    "h": 3600.0, "hr": 3600.0, "hrs": 3600.0, "hour": 3600.0, "hours": 3600.0, "d": 86400.0,
    "day": 86400.0, "days": 86400.0,
}  # fmt: skip
_WHOLE_UNITS = {
    "knot": 1852 / 3600, "knots": 1852 / 3600, "kt": 1852 / 3600, "kts": 1852 / 3600, "kn": 1852 / 3600,
    "mps": 1.0, "cmps": 0.01, "kmh": 1 / 3.6, "kph": 1 / 3.6, "kmph": 1 / 3.6, "mph": 0.44704,
}  # fmt: skip
_NO_UNITS = {"", "1", "-", "none", "unknown", "unitless", "nondimensional", "dimensionless", "n/a", "null"}
_LENGTH_WORD = "|".join(sorted(_LENGTHS, key=len, reverse=True))
_TIME_WORD = "|".join(sorted(_TIMES, key=len, reverse=True))
_RATIO = re.compile(rf"({_LENGTH_WORD})\s*(?:/\s*({_TIME_WORD})|({_TIME_WORD})\s*-\s*1)")


class Located(NamedTuple):
    """One variable and the file (as a dataset) that holds it."""

    dataset: xarray.Dataset
    name: str

    @property
    def variable(self) -> xarray.Variable:
        """The variable itself; its data stay in the file until asked for."""
        return self.dataset[self.name].variable

    def text(self, attribute: str) -> str:
        """An attribute as stripped lower-case text, '' where absent."""
        return str(self.variable.attrs.get(attribute, "")).strip().lower()


class VelocityPair(NamedTuple):
    """The two components of the current and how they point ("east", "grid" or "" for not told)."""

    u: Located
    v: Located
    direction: str
    found_by: str


def speed_unit(component: Located) -> tuple[float, str]:
    """Metres per second in one unit of ``component``, and a note where that had to be assumed."""
    text = component.text("units")
    name = f"{component.name!r}"
    if text not in _NO_UNITS:
        scale = parse_speed_unit(text)
        if scale is None:
            raise CurrentFileError(
                f"{name} has units {text!r}, which are not a speed that is understood. "
                "Set its 'units' attribute, for example to 'm s-1', 'cm s-1' or 'knots'."
            )
        return scale, ""
    in_brackets = re.search(r"[(\[]([^)\]]+)[)\]]\s*$", component.text("long_name"))
    scale = parse_speed_unit(in_brackets.group(1)) if in_brackets else None
    if in_brackets and scale is not None:
        return scale, f"{name} has no units; assumed {in_brackets.group(1)}, as its long name says"
    return 1.0, f"{name} has no units; assumed m/s"


def parse_speed_unit(text: str) -> float | None:
    """Metres per second in one ``text`` ('cm s-1', 'km/h', 'knots', ...); None if not understood."""
    plain = text.strip().lower().strip("()[] ")
    if plain in _WHOLE_UNITS:
        return _WHOLE_UNITS[plain]
    plain = plain.replace("⁻¹", "-1").replace("**", "").replace("^", "").replace("{", "").replace("}", "")
    plain = re.sub(r"\s*\bper\b\s*", "/", plain)
    plain = re.sub(r"[.*·_]", " ", plain).replace("(-1)", "-1")
    match = _RATIO.fullmatch(re.sub(r"\s+", " ", plain).strip())
    return _LENGTHS[match.group(1)] / _TIMES[match.group(2) or match.group(3)] if match else None


def find_velocity(datasets: Sequence[xarray.Dataset]) -> VelocityPair:
    """The pair of velocity components: by ``standard_name``, by a convention of names, by ``long_name``.

    Total currents go before geostrophic, barotropic and tidal ones, east and north before
    components along the grid. Raises ``CurrentFileError`` that lists the variables where there is none.
    """
    numeric = [
        Located(dataset, str(name))
        for dataset in datasets
        for name, variable in dataset.variables.items()
        if variable.dtype.kind in "iuf" and variable.ndim
    ]
    lone: list[str] = []
    for search in (_by_standard_name, _by_convention, _by_long_name):
        found = search(numeric, lone)
        if found is not None:
            return found
    if lone:
        raise CurrentFileError(
            f"only one component of the current was found ({', '.join(dict.fromkeys(lone))}). "
            "Where u and v are in two files, pass both paths: load_current_file([u_file, v_file])."
        )
    raise CurrentFileError(
        "no velocity was found: no CF standard_name such as eastward_sea_water_velocity and none of the "
        f"usual names (uo/vo, water_u/water_v, u/v ...). The variables are: {describe(datasets)}."
    )


def describe(datasets: Sequence[xarray.Dataset]) -> str:
    """The variables of the files as ``name(dimensions)``, at most 30 of them."""
    words = [
        f"{name}({', '.join(map(str, variable.dims))})"
        for dataset in datasets
        for name, variable in dataset.variables.items()
    ]
    return ", ".join(words[:30]) + (f" and {len(words) - 30} more" if len(words) > 30 else "") or "none"


def _standard_key(standard_name: str) -> tuple[str, frozenset[str]] | None:
    """Direction and the other words of a standard name of water velocity; None for any other."""
    words = standard_name.split("_")
    directions = [word for word in words if word in ("eastward", "northward", "x", "y")]
    if " " in standard_name or len(directions) != 1 or "velocity" not in words or "water" not in words:
        return None
    rest = frozenset(words) - set(directions)
    return None if rest & _FOREIGN else (directions[0], rest)


def _by_standard_name(numeric: list[Located], lone: list[str]) -> VelocityPair | None:
    keyed = [(variable, _standard_key(variable.text("standard_name"))) for variable in numeric]
    ranked: list[tuple[tuple[int, bool, int, int], VelocityPair]] = []
    for u, key in keyed:
        if key is None or key[0] not in _PARTNER:
            continue
        wanted = (_PARTNER[key[0]], key[1])
        partners = [v for v, other in keyed if other == wanted]
        if not partners:
            lone.append(f"{u.name!r} with standard_name {u.text('standard_name')!r}")
            continue
        v = _best_partner(u, partners)
        extra = key[1] - {"sea", "water", "velocity", "surface"}
        kind = 0 if not extra else 1 if "geostrophic" in extra else 2 if "barotropic" in extra else 3
        rank = (kind, key[0] == "x", _convention_rank(u.name, v.name), len(ranked))
        ranked.append((rank, VelocityPair(u, v, "grid" if key[0] == "x" else "east", "standard_name")))
    if not ranked:
        # A northward component alone is as telling as an eastward one.
        lone += [
            f"{v.name!r} with standard_name {v.text('standard_name')!r}"
            for v, key in keyed
            if key is not None and key[0] in _PARTNER.values() and not lone
        ]
        return None
    return min(ranked, key=lambda item: item[0])[1]


def _best_partner(u: Located, candidates: list[Located]) -> Located:
    """Of several v the one named like ``u``, on the same dimensions."""
    return min(candidates, key=lambda v: (not _alike(u.name, v.name), u.variable.dims != v.variable.dims))


def _alike(u_name: str, v_name: str) -> bool:
    """Whether ``v_name`` is ``u_name`` with its direction swapped."""
    swapped = u_name.lower()
    for a, b in (("eastward", "northward"), ("east", "north"), ("zonal", "meridional")):
        swapped = swapped.replace(a, b)
    low = v_name.lower()
    return low in (swapped, swapped.replace("u", "v"), swapped.replace("x", "y")) or any(
        swapped[:i] + b + swapped[i + 1 :] == low
        for i, letter in enumerate(swapped)
        for a, b in (("u", "v"), ("x", "y"))
        if letter == a
    )


def _convention_rank(u_name: str, v_name: str) -> int:
    pair = (u_name.lower(), v_name.lower())
    return next((i for i, names in enumerate(CONVENTIONS) if names[:2] == pair), len(CONVENTIONS))


def _is_water(variable: Located) -> bool:
    """Whether nothing says that this is a velocity of wind or ice, an error, a flag or the like."""
    words = f"{variable.text('standard_name')} {variable.text('long_name')}".replace("_", " ")
    return not _FOREIGN_TEXT.search(words)


def _by_convention(numeric: list[Located], lone: list[str]) -> VelocityPair | None:
    by_name: dict[str, Located] = {}
    for variable in numeric:
        if _is_water(variable):
            by_name.setdefault(variable.name.lower(), variable)
    for u_name, v_name, direction in CONVENTIONS:
        u, v = by_name.get(u_name), by_name.get(v_name)
        if u is not None and v is not None:
            words = f"{u.text('standard_name')} {u.text('long_name')}".replace("_", " ")
            if re.search(r"\b(eastward|zonal)\b", words):
                direction = "east"
            elif not direction and re.search(r"\b(x|xi|i)\b[- ]?(axis|velocity|direction|component)", words):
                direction = "grid"
            return VelocityPair(u, v, direction, "name")
        lone += [repr(one.name) for one in (u, v) if one is not None]
    return None


def _by_long_name(numeric: list[Located], lone: list[str]) -> VelocityPair | None:
    patterns = (
        ("east", r"\b(eastward|zonal|east)\b", r"\b(northward|meridional|north)\b"),
        ("", r"\bu[- ]?(component|velocity|current)", r"\bv[- ]?(component|velocity|current)"),
        ("grid", r"\bx[- ]?(component|velocity|direction)", r"\by[- ]?(component|velocity|direction)"),
    )
    moving = [
        variable
        for variable in numeric
        if _is_water(variable) and re.search(r"velocity|current|drift", variable.text("long_name"))
    ]
    for direction, u_pattern, v_pattern in patterns:
        us, vs = (
            [variable for variable in moving if re.search(pattern, variable.text("long_name"))]
            for pattern in (u_pattern, v_pattern)
        )
        if us and vs:
            return VelocityPair(us[0], _best_partner(us[0], vs), direction, "long_name")
        lone += [repr(one.name) for one in (us or vs)[:1]]
    return None


def is_latitude(variable: Located) -> bool:
    """Whether a variable holds true latitude (not that of a rotated pole, nor cell bounds)."""
    return _is_coordinate(variable, "latitude", r"degrees?_?n(orth)?", _LATITUDE_NAME)


def is_longitude(variable: Located) -> bool:
    """Whether a variable holds true longitude (not that of a rotated pole, nor cell bounds)."""
    return _is_coordinate(variable, "longitude", r"degrees?_?e(ast)?", _LONGITUDE_NAME)


_LATITUDE_NAME = re.compile(
    r"(nav_|x)?lat(itude)?s?([_-]?(rho|u|v|t|c|r|\d))?|gphi[tuv]?|geolat(_[tcuv])?|[tupqy]lat(itude)?"
)
_LONGITUDE_NAME = re.compile(
    r"(nav_|x)?lon(g|gitude)?s?([_-]?(rho|u|v|t|c|r|\d))?|glam[tuv]?|geolon(_[tcuv])?|[tupqx]lon(g|gitude)?"
)


def _is_coordinate(variable: Located, standard_name: str, units: str, names: re.Pattern[str]) -> bool:
    if variable.variable.dtype.kind not in "iuf":
        return False
    named = variable.text("standard_name")
    if named == f"grid_{standard_name}" or re.search(r"bnds|bounds|vertices|corner", variable.name.lower()):
        return False
    if named == standard_name or re.fullmatch(units, variable.text("units")):
        return True
    return names.fullmatch(variable.name.lower()) is not None


TIME_NAMES = {
    "time", "ocean_time", "t", "time_counter", "mt", "date", "valid_time", "record", "times", "time_instant",
    "tstep", "ntime", "nt", "time1", "forecast_time", "datetime", "juld", "step", "lead", "leadtime", "forecast_period",
}  # fmt: skip
_DEPTH_NAME = re.compile(
    r"(model_)?(depth\w*|lev\w*|z|zt|z_\w+|zlev\w*|s_rho|s_w|sigma\w*|siglay|layers?|sc_r|st_ocean|k|nz|nk|nlev"
    r"|nlayer\w*|plev|kbm?|height\w*|altitude|pres\w*|n_levels)"
)
_DEPTH_STANDARD = re.compile(
    r"depth.*|height.*|altitude|ocean_s.*|ocean_sigma.*|.*pressure.*|model_level_number"
)
_MEMBER_NAME = re.compile(r"ens\w*|member\w*|number|reali[sz]ation\w*|perturbation\w*|nens|run|scenario")


def dimension_kind(dataset: xarray.Dataset, dimension: str) -> str:
    """What a dimension is: "time", "depth", "member" (of an ensemble) or "" (horizontal or not known)."""
    low = dimension.lower()
    named = Located(dataset, dimension) if dimension in dataset.variables else None
    if named is not None:
        axis, standard = named.text("axis"), named.text("standard_name")
        if axis in ("x", "y"):
            return ""
        if standard == "realization" or axis == "e":
            return "member"
        if axis == "t" or standard == "time" or " since " in named.text("units"):
            return "time"
        if axis == "z" or _DEPTH_STANDARD.fullmatch(standard) or named.text("positive") in ("up", "down"):
            return "depth"
        if is_latitude(named) or is_longitude(named):
            return ""
    if low in TIME_NAMES or low.endswith("_time") or low.startswith("time"):
        return "time"
    if _MEMBER_NAME.fullmatch(low):
        return "member"
    return "depth" if _DEPTH_NAME.fullmatch(low) else ""


def find_time(dataset: xarray.Dataset, dimension: str | None, hints: str = "") -> Located | None:
    """The variable that dates the steps along ``dimension`` (None: a scalar time of a single field)."""
    shape = () if dimension is None else (dimension,)
    found = []
    for name, variable in dataset.variables.items():
        located = Located(dataset, str(name))
        dated = " since " in located.text("units")
        low = located.name.lower()
        text_dates = variable.dtype.kind in "SUO" and variable.dims[:1] == shape and low in TIME_NAMES
        if not text_dates and variable.dims != shape:
            continue
        timely = located.text("standard_name") == "time" or located.text("axis") == "t" or low in TIME_NAMES
        if located.text("standard_name") == "forecast_reference_time" or not (
            dated or timely or located.name == dimension
        ):
            continue
        if dimension is None and not timely:
            continue
        hinted = re.search(rf"\b{re.escape(low)}\b", hints) is not None
        found.append(((not dated, not hinted, not timely, located.name != dimension), located))
    return min(found, key=lambda item: item[0])[1] if found else None


def find_angle(datasets: Sequence[xarray.Dataset], shape: tuple[int, int]) -> Located | None:
    """The variable on a grid of ``shape`` that holds the angle from east to the grid's x axis, if any."""
    for dataset in datasets:
        for name, variable in dataset.variables.items():
            located = Located(dataset, str(name))
            known = located.name.lower() in ("angle", "angle_rho", "anglet", "grid_angle", "ang", "rotang")
            known = known or located.text("standard_name").startswith("angle_of_rotation_from_east_to_x")
            if known and variable.dtype.kind in "iuf" and variable.shape[-2:] == shape and variable.ndim >= 2:
                return located
    return None


def find_mask(
    datasets: Sequence[xarray.Dataset], shape: tuple[int, int], names: Sequence[str]
) -> Located | None:
    """A water mask (1 water, 0 land; the reverse for ``land_binary_mask``) on a grid of ``shape``."""
    for dataset in datasets:
        for name, variable in dataset.variables.items():
            located = Located(dataset, str(name))
            standard = located.text("standard_name")
            known = located.name.lower() in names or standard in ("sea_binary_mask", "land_binary_mask")
            if known and variable.dtype.kind in "iufb" and variable.shape == shape:
                return located
    return None

"""Functions that the C text of a program may need, each by the name that calls it."""

_LIMIT = """static {t} limit{w}({t} value, {t} least, {t} most)
{{
    return value < least ? least : value > most ? most : value;
}}"""
_PAIR = """static {t} {n}{w}({t} a, {t} b)
{{
    return a {s} b ? a : b;
}}"""
_ABSOLUTE = """static {t} absolute{w}({t} value)
{{
    return value < 0 ? -value : value;
}}"""
_QUOTIENT = """/* to the nearest, halves away from 0; 0 where b is 0 */
static {t} quotient{w}({t} a, {t} b)
{{
    const u{t} top = a < 0 ? 0u - (u{t})a : (u{t})a;
    const u{t} bottom = b < 0 ? 0u - (u{t})b : (u{t})b;
    {t} whole;
    if (b == 0) {{
        return 0;
    }}
    whole = ({t})((top + bottom / 2u) / bottom);
    return (a < 0) != (b < 0) ? -whole : whole;
}}"""
_ROOT = """/* the largest whole number whose square is not above the value */
static {t} root{w}({t} value)
{{
    u{t} left = value > 0 ? (u{t})value : 0u, root = 0u, bit = (u{t})1 << {top};
    while (bit > left) {{
        bit >>= 2;
    }}
    while (bit != 0u) {{
        if (left >= root + bit) {{
            left -= root + bit;
            root = (root >> 1) + bit;
        }} else {{
            root >>= 1;
        }}
        bit >>= 2;
    }}
    return ({t})root;
}}"""
_CUBE_ROOT = """/* the largest whole number whose cube is not above the value */
static int64_t cube_root64(int64_t value)
{
    uint64_t left = value > 0 ? (uint64_t)value : 0u, root = 0u;
    int place;
    for (place = 60; place >= 0; place -= 3) {
        uint64_t step;
        root *= 2u;
        step = 3u * root * (root + 1u) + 1u;
        if ((left >> place) >= step) {
            left -= step << place;
            root += 1u;
        }
    }
    return (int64_t)root;
}"""
_REALS = {
    "minimum_real": _PAIR.format(t="float", n="minimum", w="_real", s="<"),
    "maximum_real": _PAIR.format(t="float", n="maximum", w="_real", s=">"),
    "absolute_real": _ABSOLUTE.format(t="float", w="_real"),
    "ratio": """static float ratio(float a, float b)
{
    return b < 0.0f || b > 0.0f ? a / b : 0.0f;
}""",
    "real_root": "static float real_root(float a)\n{\n    return a > 0.0f ? sqrtf(a) : 0.0f;\n}",
    "power": """static float power(float a, float b)
{
    return a > 0.0f ? expf(b * logf(a)) : 0.0f;
}""",
    "logarithm": "static float logarithm(float a)\n{\n    return a > 0.0f ? logf(a) : 0.0f;\n}",
    "exponential": "static float exponential(float a)\n{\n    return expf(a);\n}",
}


def _whole_ones(bits: int) -> dict[str, str]:
    kind, width = f"int{bits}_t", str(bits)
    return {
        f"limit{bits}": _LIMIT.format(t=kind, w=width),
        f"minimum{bits}": _PAIR.format(t=kind, n="minimum", w=width, s="<"),
        f"maximum{bits}": _PAIR.format(t=kind, n="maximum", w=width, s=">"),
        f"absolute{bits}": _ABSOLUTE.format(t=kind, w=width),
        f"quotient{bits}": _QUOTIENT.format(t=kind, w=width),
        f"root{bits}": _ROOT.format(t=kind, w=width, top=bits - 2),
    }


HELPERS = {**_whole_ones(32), **_whole_ones(64), "cube_root64": _CUBE_ROOT, **_REALS}
"""By name."""

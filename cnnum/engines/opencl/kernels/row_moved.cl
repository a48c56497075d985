// The cells that begin within a vector: both vectors that hold them are loaded as they lie.
static inline vec $moved($space const scalar *const y)
{
    const vec a = *($space const vec *)y, b = *($space const vec *)(y + $width);
    return (vec)($lanes);
}

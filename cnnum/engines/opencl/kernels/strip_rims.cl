// Virtual cells on both sides of a row that begins at p.
static inline void sides$suffix(__global scalar *const y, const int p)
{
$sides
}

static inline void all_sides$suffix(__global scalar *const y, const int p)
{
    for (int layer = 0; layer < $layers; ++layer) {
        sides$suffix(y, p + layer * $span);
    }
}

static void upper$suffix(__global scalar *const y)
{
$upper
}

static void lower$suffix(__global scalar *const y)
{
$lower
}

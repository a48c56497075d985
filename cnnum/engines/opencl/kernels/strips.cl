// Strips of rows, several levels at a time: a level is a stage of a step. It follows the one before
// at a distance of a few rows, so that its reads are still in the cache. Strips narrow by
// a rim from level to level; then what is missing between them is made up for. Of the two arrays of
// outputs, a level reads one and writes the other. The rows of all layers stand side by side.
$lanes
static inline vec shown(vec x, const vec one) { return $shown; }

// What a state may move that stops at -1 and 1. What is NaN stays NaN.
static inline vec inwards(const vec d, const vec x, const vec one)
{
    const vec none = one - one;
    const vec falls = x < one ? d : (none < d ? none : d);
    return -one < x ? falls : (falls < none ? none : falls);
}

// A 1 that compilers do not see: with constants they compare and blend, which takes a fifth longer
// in all than the processor's own minimum and maximum.
static inline vec hidden_one(void)
{
    volatile scalar one = 1;
    return (vec)(one);
}

static inline vec magnitude(const vec a) { return a < -a ? -a : a; }

// What is NaN in either stays NaN.
static inline vec greatest(const vec a, const vec b) { return (a < b) | (b != b) ? b : a; }

static void show_row(__global scalar *const to, __global const scalar *const from)
{
    const vec one = hidden_one();
    for (int n = 0; n < $length; ++n) {
        *(__global vec *)(to + n * $width) = shown(*(__global const vec *)(from + n * $width), one);
    }
}

$rims

// Where outputs are, and states that are padded as they are, after so many levels.
static inline __global scalar *outputs_of(__global scalar *const x, const int level)
{
    return $outputs_of;
}

static inline __global scalar *states_of(__global scalar *const x, const int level)
{
    return $states_of;
}

static void rims_at_ends(__global scalar *const x, __global scalar *const to, const int start,
                        const int level)
{
    $at_ends
}

static void rims_above(__global scalar *const x, __global scalar *const to, const int level)
{
    $above
}

static void rims_below(__global scalar *const x, __global scalar *const to, const int level)
{
    $below
}

// Where a strip keeps the largest of a figure in its cells, in every lane.
static inline __global vec *finding(__global scalar *const x, const int n, const int piece)
{
    return (__global vec *)(x + $found + (n * $strips + piece) * $width);
}

static void one_row(__global scalar *const x, __global const scalar *const w,
                    __global const scalar *const from, __global scalar *const to, const int start,
                    const int number, const int piece)
{
    const vec one = hidden_one();
$reads
    switch ($case) {
$one_row
    }
    rims_at_ends(x, to, start, number + 1);
}

static void more_rows(__global scalar *const x, __global const scalar *const w,
                      __global const scalar *const from, __global scalar *const to,
                      const int start, const int number, const int piece)
{
    const vec one = hidden_one();
$reads
    switch ($case) {
$more_rows
    }
    for (int r = 0; r < $block; ++r) {
        rims_at_ends(x, to, start + r * $pitch, number + 1);
    }
}

// One level of a block of rows of a strip.
static void take_level(__global scalar *const x, __global const scalar *const w,
                       __global const scalar *const from, __global scalar *const to,
                       const int row, const int end, const int number, const int piece)
{
    if (row + $block <= end) {
        more_rows(x, w, from, to, ROW(row), number, piece);
    } else {
        for (int r = row; r < end; ++r) {
            one_row(x, w, from, to, ROW(r), number, piece);
        }
    }
}

// Phases: 0 sets out from the states. 1 takes levels after those that are done. 2 makes up for what
// is missing between strips. 3 brings the states back. 4 takes them back to where levels began.
static void strip(__global scalar *const mine, const int pieces, const int piece, const int phase,
                  const int done, const int most)
{
    __global scalar *const x = mine + $x, *const w = mine + $w;
    const int begin = (int)((long)$rows * piece / pieces);
    const int end = (int)((long)$rows * (piece + 1) / pieces);
    const int count = $count, ahead = $ahead;
    if (phase == 0 || phase == 4) {
        for (int n = 0; phase == 0 && piece == 0 && n < $findings * $strips * $width; ++n) {
            x[$found + n] = 0;
        }
        // which numbers of a row are cells
        for (int n = 0; phase == 0 && piece == 0 && n < $marked; ++n) {
            x[$marks + n] = n % $width * $length + n / $width < $cols;
        }
        const int above = $periodic && begin == 0 ? $radius : 0;
        const int below = $periodic && end == $rows ? $radius : 0;
        for (int r = begin - above; r < end + below; ++r) {
            const int row = (r % $rows + $rows) % $rows;
            for (int layer = 0; layer < $layers; ++layer) {
                const int at = row * $cols, cell = layer * $rows * $cols + at;
                const int p = ROW(r) + layer * $span;
                if (phase == 0) {
                    to_lanes(x + p, mine + $state + cell, 1);
                    $drive
                    $rest
                } else {
                    $again
                }
            }
            rims_at_ends(x, outputs_of(x, ahead), ROW(r), 0);
        }
        if (!$periodic && begin == 0) {
            rims_above(x, outputs_of(x, ahead), 0);
        }
        if (!$periodic && end == $rows) {
            rims_below(x, outputs_of(x, ahead), 0);
        }
    } else if (phase == 1) {
        for (int n = 0; done == 0 && n < $findings; ++n) {
            *finding(x, n, piece) = (vec)(0);
        }
        const int rim = min($radius, $rows);
        const int top = begin == 0 && !$periodic, bottom = end == $rows && !$periodic;
        for (int taken = 0; taken < count; taken += $levels) {
            const int levels = min($levels, count - taken);
            const int blocks = (end - begin + $block - 1) / $block;
            const int lag = (2 * $radius + $block - 1) / $block;
            for (int wave = 0; wave < blocks + (levels - 1) * lag; ++wave) {
                for (int n = 1; n <= levels && wave >= (n - 1) * lag; ++n) {
                    const int low = top ? 0 : begin + n * $radius;
                    const int high = bottom ? $rows : end - n * $radius;
                    const int row = low + (wave - (n - 1) * lag) * $block;
                    if (row < high) {
                        const int before = done + taken + n - 1;
                        __global const scalar *const from = outputs_of(x, ahead + before);
                        __global scalar *const to = outputs_of(x, ahead + before + 1);
                        take_level(x, w, from, to, row, high, before, piece);
                        if (top && row < rim && row + $block >= rim) {
                            rims_above(x, to, before + 1);
                        }
                        if (row + $block >= $rows && bottom) {
                            rims_below(x, to, before + 1);
                        }
                    }
                }
            }
        }
    } else if (phase == 2 && ($periodic || end < $rows)) {
        for (int n = 1; n <= count; ++n) {
            __global const scalar *const from = outputs_of(x, ahead + done + n - 1);
            __global scalar *const to = outputs_of(x, ahead + done + n);
            // all rows of an array that is lower than that
            const int high = min(2 * n * $radius, $rows);
            for (int r = end - n * $radius; r < end - n * $radius + high; ++r) {
                const int row = (r % $rows + $rows) % $rows;
                one_row(x, w, from, to, ROW(row), done + n - 1, piece);
            }
            if (end == $rows) {
                rims_above(x, to, done + n);
                rims_below(x, to, done + n);
            }
        }
    } else if (phase == 3) {
        __global const scalar *const end_state = x + $end;
        for (int r = begin; r < end; ++r) {
            for (int layer = 0; layer < $layers; ++layer) {
                const int cell = layer * $rows * $cols + r * $cols;
                from_lanes(mine + $state + cell, end_state + ROW(r) + layer * $span);
            }
        }
    }
}

// What one work item does for a frame: a phase at first if there is one, levels, and the way back.
static void ${kernel}_alone(__global scalar *const mine, const int first, const int count,
                            const int ends)
{
    if (first >= 0) {
        strip(mine, 1, 0, first, 0, 0);
    }
    for (int done = 0; done < count; done += $levels) {
        strip(mine, 1, 0, 1, done, min($levels, count - done));
        strip(mine, 1, 0, 2, done, min($levels, count - done));
    }
    if (ends) {
        strip(mine, 1, 0, 3, 0, 0);
    }
}

// A phase of the frames whose register `guard` is not 0 (negative: of all).
__kernel __attribute__((reqd_work_group_size(1, 1, 1)))
void $kernel(__global scalar *scratch, __global const scalar *registers, const int guard,
             const int frames, const int pieces, const int phase, const int done,
             const int count)
{
    const int frame = get_global_id(0) / pieces;
    if (guard < 0 || registers[guard * frames + frame] != 0) {
        __global scalar *const mine = scratch + (size_t)frame * FRAME_SIZE;
        strip(mine, pieces, get_global_id(0) % pieces, phase, done, count);
    }
}

// Several steps of a tile while it is in a core's cache; tiles overlap by what their rims lose.
typedef scalar vec __attribute__((ext_vector_type($width), aligned($bytes)));

static inline vec shown(const vec x) { return $shown; }

static void rims(__global scalar *y, const int low, const int high, const int top,
                 const int bottom, const int left, const int right)
{
$rims
}

__kernel __attribute__((reqd_work_group_size(1, 1, 1)))
void advance(__global scalar *scratch, __global scalar *tiles, const int frames,
             const int source, const int target, const int steps)
{
    __global scalar *const x = tiles + get_global_id(0) * $tile_size + $slack;
    __global scalar *const w = x + $area;
    __global scalar *from = w + $area, *to = from + $area;
    for (int tile = get_global_id(0); tile < $tiles * frames; tile += get_global_size(0)) {
        __global scalar *const mine = scratch + (size_t)(tile / $tiles) * $frame_size;
        const int r0 = (tile % $tiles) / $across * $tile_rows;
        const int c0 = (tile % $tiles) % $across * $tile_cols;
        const int r1 = min(r0 + $tile_rows, $rows), c1 = min(c0 + $tile_cols, $cols);
        const int reach = steps * $radius;
        const int top = !$periodic && r0 - reach <= 0, left = !$periodic && c0 - reach <= 0;
        const int bottom = !$periodic && r1 + reach >= $rows;
        const int right = !$periodic && c1 + reach >= $cols;
        const int ra = top ? 0 : r0 - reach, rb = bottom ? $rows : r1 + reach;
        const int ca = left ? 0 : c0 - reach, cb = right ? $cols : c1 + reach;
        // cell (r, c) stands at (r - r0 + $halo) * $pitch + c - c0 + $margin
        for (int r = ra; r < rb; ++r) {
            const int row = $wrap_row, at = (r - r0 + $halo) * $pitch - c0 + $margin;
            for (int c = ca; c < cb; c += $stride) {
                const int cell = row * $cols + $wrap_col;
                const $group value = *(__global const $group *)(mine + source + cell);
                *(__global $group *)(x + at + c) = value;
                *(__global $group *)(w + at + c) = $drive;
                *(__global $group *)(from + at + c) = $first;
            }
        }
        const int low = (ra - r0 + $halo), high = (rb - r0 + $halo);
        const int begin = left ? $margin : 0, end = cb - c0 + $margin;
        rims(from, low, high, top ? low : -1, bottom ? high : -1,
             left ? $margin - c0 : -1, right ? $cols - c0 + $margin : -1);
        for (int n = 1; n <= steps; ++n) {
            const int first = top ? low : low + n * $radius;
            const int last = bottom ? high : high - n * $radius;
            for (int r = first; r < last; r += $block) {
                for (int c = begin; c < end; c += $width) {
                    const int p = r * $pitch + c;
$step
                }
            }
            rims(to, first, last, top ? low : -1, bottom ? high : -1,
                 left ? $margin - c0 : -1, right ? $cols - c0 + $margin : -1);
            __global scalar *const swap = from; from = to; to = swap;
        }
        for (int r = r0; r < r1; ++r) {
            const int at = (r - r0 + $halo) * $pitch - c0 + $margin;
            __global scalar *const end_of = mine + target + r * $cols;
            int c = c0;
            for (; c + $width <= c1; c += $width) {
                *(__global vec *)(end_of + c) = *(__global const vec *)(x + at + c);
            }
            for (; c < c1; ++c) {
                end_of[c] = x[at + c];
            }
        }
    }
}

// Rows of cells in lanes: a row is cut into as many pieces as a vector has lanes, a piece each. So
// neighbours of a vector's cells are a vector, too.
typedef scalar vec __attribute__((ext_vector_type($width), aligned($bytes)));
#define ROW(row) (((row) + $radius) * $pitch + $head)

static inline vec between(const vec a, const vec low, const vec high)
{
    const vec most = high < a ? high : a;
    return most < low ? low : most;
}

// Asks for what is read soon: pieces that are read by turns are no order that processors foresee.
#ifndef SOON
#if defined(__has_builtin) && __has_builtin(__builtin_prefetch) && !defined(__NV_CL_C_VERSION)
#define SOON(place) __builtin_prefetch((const void *)(uintptr_t)(place))
#else
#define SOON(place)
#endif
#endif

// A square of as many vectors as they have lanes: what were lanes become vectors. Merged in pairs,
// number by number, the vectors' place in the square moves by a digit.
static inline void turned(vec *const a)
{
#pragma unroll
    for (int digit = 1; digit < $width; digit *= 2) {
        vec b[$width];
#pragma unroll
        for (int k = 0; k < $width; ++k) {
            b[k] = a[k];
        }
#pragma unroll
        for (int k = 0; k < $width / 2; ++k) {
            a[2 * k].even = b[k].lo;
            a[2 * k].odd = b[k + $width / 2].lo;
            a[2 * k + 1].even = b[k].hi;
            a[2 * k + 1].odd = b[k + $width / 2].hi;
        }
    }
}

// Numbers of a row, of which there may be fewer than a vector has.
static inline vec part_of(__global const scalar *const from, const int count)
{
    if (count >= $width) {
        return *(__global const vec *)from;
    }
    scalar found[$width];
    for (int n = 0; n < $width; ++n) {
        found[n] = n < count ? from[n] : 0;
    }
    return *(const vec *)found;
}

// This and what keeps lanes are not drawn into what calls them: compilers took half a second longer
// for each.
// Keeps a square of vectors, from the row's vector `at` on, as pieces of its cells.
static __attribute__((noinline)) void keep_cells(__global scalar *const to, vec *const a, const int at)
{
    turned(a);
#pragma unroll
    for (int lane = 0; lane < $width; ++lane) {
        const int start = lane * $length + at;
        const int count = min($length - at, $cols - start);
        SOON(to + start + $cols);
        if (count >= $width) {
            *(__global vec *)(to + start) = a[lane];
        } else {
            scalar kept[$width];
            *(vec *)kept = a[lane];
            for (int k = 0; k < count; ++k) {
                to[start + k] = kept[k];
            }
        }
    }
}

// Keeps a square of pieces of a row, times a factor, as vectors from `at` on.
static __attribute__((noinline)) void keep_lanes(__global scalar *const to, vec *const a, const int at,
                              const scalar factor)
{
    turned(a);
#pragma unroll
    for (int k = 0; k < $width; ++k) {
        if (at + k < $length) {
            *(__global vec *)(to + (at + k) * $width) = (vec)(factor) * a[k];
        }
    }
}

// A row's cells, times a factor, each piece to its lane; lanes without a cell hold 0.
static void to_lanes(__global scalar *const to, __global const scalar *const from,
                     const scalar factor)
{
    for (int n = 0; n < $length; n += $width) {
        const int at = min(n, $last);
        vec a[$width];
#pragma unroll
        for (int lane = 0; lane < $width; ++lane) {
            const int start = lane * $length + at;
            a[lane] = part_of(from + start, $cols - start);
            SOON(from + start + $cols);
        }
        keep_lanes(to, a, at, factor);
    }
}

// The way back.
static void from_lanes(__global scalar *const to, __global const scalar *const from)
{
    for (int n = 0; n < $length; n += $width) {
        const int at = min(n, $last);
        vec a[$width];
#pragma unroll
        for (int k = 0; k < $width; ++k) {
            a[k] = *(__global const vec *)(from + min(at + k, $length - 1) * $width);
        }
        keep_cells(to, a, at);
    }
}

static void fill_lanes(__global scalar *const to, const scalar value)
{
    for (int n = 0; n < $length; ++n) {
        *(__global vec *)(to + n * $width) = (vec)(value);
    }
}

static void copy_lanes(__global scalar *const to, __global const scalar *const from)
{
    for (int n = 0; n < $length; ++n) {
        *(__global vec *)(to + n * $width) = *(__global const vec *)(from + n * $width);
    }
}

// Virtual rows are copies of rows.
static void copy_row(__global scalar *const y, const int to, const int from)
{
    for (int c = -$head; c < $pitch - $head; ++c) {
        y[ROW(to) + c] = y[ROW(from) + c];
    }
}

static void fill_row(__global scalar *const y, const int to, const scalar value)
{
    for (int c = -$head; c < $pitch - $head; ++c) {
        y[ROW(to) + c] = value;
    }
}

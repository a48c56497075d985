#define PICK(condition, yes, no) ((condition) ? (real)(yes) : (real)(no))
#define ANY_LANE(value) any_lane((value) != ZERO)
#define greater(a, b) fmax(a, b)

static inline int any_lane(const $bits lanes) { return any(lanes.lo | lanes.hi); }

static inline scalar largest_lane(const real value)
{
    scalar largest = ((const scalar *)&value)[0];
    for (int l = 1; l < LANES; ++l) {
        const scalar lane = ((const scalar *)&value)[l];
        largest = lane > largest ? lane : largest;
    }
    return largest;
}
#define LARGEST_LANE(value) largest_lane(value)

// The tail of a batch repeats its last frame in the lanes that are left over.
static real gather(__global const scalar *base, const int frame, const int last, const int stride)
{
    real value;
    for (int l = 0; l < LANES; ++l) {
        ((scalar *)&value)[l] = base[(size_t)min(frame + l, last) * stride];
    }
    return value;
}

static void scatter(__global scalar *base, const int frame, const int last, const int stride,
                    const real value)
{
    const scalar *lane = (const scalar *)&value;
    for (int l = 0; l < LANES; ++l) {
        if (frame + l <= last) {
            base[(size_t)(frame + l) * stride] = lane[l];
        }
    }
}

// A square of as many numbers as lanes, from as many frames: what were frames become lanes. Merged
// in pairs, number by number, the vectors' place in the square moves by a digit.
static inline void turned_lanes(real *const a)
{
#pragma unroll
    for (int digit = 1; digit < LANES; digit *= 2) {
        real b[LANES];
#pragma unroll
        for (int k = 0; k < LANES; ++k) {
            b[k] = a[k];
        }
#pragma unroll
        for (int k = 0; k < LANES / 2; ++k) {
            a[2 * k].even = b[k].lo;
            a[2 * k].odd = b[k + LANES / 2].lo;
            a[2 * k + 1].even = b[k].hi;
            a[2 * k + 1].odd = b[k + LANES / 2].hi;
        }
    }
}

typedef scalar lanes_anywhere __attribute__((ext_vector_type(LANES), aligned(sizeof(scalar))));

// Not drawn into what calls them, as a plan has dozens of maps.
static __attribute__((noinline)) void gather_map(real *const to, __global const scalar *const base,
                                                 const int frame, const int last, const int stride,
                                                 const int count)
{
    int i = 0;
    for (; frame + LANES - 1 <= last && i + LANES <= count; i += LANES) {
        real a[LANES];
#pragma unroll
        for (int l = 0; l < LANES; ++l) {
            a[l] = *(__global const lanes_anywhere *)(base + (size_t)(frame + l) * stride + i);
        }
        turned_lanes(a);
#pragma unroll
        for (int l = 0; l < LANES; ++l) {
            to[i + l] = a[l];
        }
    }
    for (; i < count; ++i) {
        to[i] = gather(base + i, frame, last, stride);
    }
}

static __attribute__((noinline)) void scatter_map(__global scalar *const base, const int frame,
                                                  const int last, const int stride,
                                                  const real *const from, const int count)
{
    int i = 0;
    for (; frame + LANES - 1 <= last && i + LANES <= count; i += LANES) {
        real a[LANES];
#pragma unroll
        for (int l = 0; l < LANES; ++l) {
            a[l] = from[i + l];
        }
        turned_lanes(a);
#pragma unroll
        for (int l = 0; l < LANES; ++l) {
            *(__global lanes_anywhere *)(base + (size_t)(frame + l) * stride + i) = a[l];
        }
    }
    for (; i < count; ++i) {
        scatter(base + i, frame, last, stride, from[i]);
    }
}

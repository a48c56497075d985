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

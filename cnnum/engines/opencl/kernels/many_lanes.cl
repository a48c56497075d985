#define PICK(condition, yes, no) select((real)(no), (real)(yes), (condition))
#define ANY_LANE(value) any((value) != ZERO)

// The tail of a batch repeats its last frame in the lanes that are left over.
static real gather(__global const scalar *base, const int frame, const int last, const int stride)
{
    scalar lane[LANES];
    for (int l = 0; l < LANES; ++l) {
        lane[l] = base[(size_t)min(frame + l, last) * stride];
    }
    return vload$lanes(0, lane);
}

static void scatter(__global scalar *base, const int frame, const int last, const int stride,
                    const real value)
{
    scalar lane[LANES];
    vstore$lanes(value, 0, lane);
    for (int l = 0; l < LANES; ++l) {
        if (frame + l <= last) {
            base[(size_t)(frame + l) * stride] = lane[l];
        }
    }
}

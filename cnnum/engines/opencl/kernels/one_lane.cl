#define PICK(condition, yes, no) ((condition) ? (yes) : (no))
#define ANY_LANE(value) ((value) != ZERO)
#define LARGEST_LANE(value) (value)

static real gather(__global const scalar *base, const int frame, const int last, const int stride)
{
    return base[(size_t)frame * stride];
}

static void scatter(__global scalar *base, const int frame, const int last, const int stride,
                    const real value)
{
    base[(size_t)frame * stride] = value;
}

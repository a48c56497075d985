#define PICK(condition, yes, no) ((condition) ? (yes) : (no))
#define ANY_LANE(value) ((value) != ZERO)
#define LARGEST_LANE(value) (value)

// The larger of two numbers that are not negative: as bits, which compilers take many at a time.
static inline real greater(const real a, const real b)
{
    const $bits x = as_$bits(a), y = as_$bits(b);
    return as_$real(x < y ? y : x);
}

static real gather(__global const scalar *base, const int frame, const int last, const int stride)
{
    return base[(size_t)frame * stride];
}

static void scatter(__global scalar *base, const int frame, const int last, const int stride,
                    const real value)
{
    base[(size_t)frame * stride] = value;
}

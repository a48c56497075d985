// Comparisons and bits in place of the built-ins of these names: some builds of PoCL cannot
// compile those of 64-byte vectors, and on others they are calls. What is NaN in `a` stays NaN.
static inline real larger(const real a, const real b) { return a < b ? b : a; }
static inline real smaller(const real a, const real b) { return b < a ? b : a; }
static inline real within(const real a, const real low, const real high)
{
    return smaller(larger(a, low), high);
}
static inline real size_of(const real a) { return as_$real(as_$bits(a) & ($bits)($mask)); }
#define fmax larger
#define fmin smaller
#define clamp within
#define fabs size_of

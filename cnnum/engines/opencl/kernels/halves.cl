// Built-ins of 64-byte vectors, by halves.
static inline real exp_halves(const real a) { return (real)(exp(a.lo), exp(a.hi)); }
static inline real expm1_halves(const real a) { return (real)(expm1(a.lo), expm1(a.hi)); }
static inline real log_halves(const real a) { return (real)(log(a.lo), log(a.hi)); }
static inline real log1p_halves(const real a) { return (real)(log1p(a.lo), log1p(a.hi)); }
static inline real sqrt_halves(const real a) { return (real)(sqrt(a.lo), sqrt(a.hi)); }
static inline real tanh_halves(const real a) { return (real)(tanh(a.lo), tanh(a.hi)); }
static inline real pow_halves(const real a, const real b)
{
    return (real)(pow(a.lo, b.lo), pow(a.hi, b.hi));
}
#define exp exp_halves
#define expm1 expm1_halves
#define log log_halves
#define log1p log1p_halves
#define sqrt sqrt_halves
#define tanh tanh_halves
#define pow pow_halves

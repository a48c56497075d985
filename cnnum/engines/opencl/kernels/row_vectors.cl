typedef scalar vec __attribute__(($attributes));

static inline vec between(const vec a, const vec low, const vec high)
{
    const vec most = high < a ? high : a;
    return most < low ? low : most;
}

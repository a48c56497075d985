// One row of the array a vector: a single frame stays in registers from step to step.
typedef $row row;
static inline row clip_row(const row a)
{
    const row low = (row)(-1), high = (row)(1), floor = a < low ? low : a;
    return high < floor ? high : floor;
}

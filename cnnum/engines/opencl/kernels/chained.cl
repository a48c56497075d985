// The read-out "$read_out" of $count numbers in chains of every ${chains}th of them. Then one half of
// the chains is taken with the other. Written into every loop that it follows it takes twice as long to build.
static __attribute__((noinline)) real ${function}(__private const real *numbers)
{
    $body
}

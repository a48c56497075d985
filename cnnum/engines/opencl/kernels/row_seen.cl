{
    const int p = (own + $radius) * $pitch + $place;
#pragma clang loop vectorize(assume_safety)
    for (int c = 0; c < $cols; ++c) {
        const int i = row * $cols + c;
        real now;
        $value
        $array[p + c] = now;
    }
    $virtual
    $beyond
}

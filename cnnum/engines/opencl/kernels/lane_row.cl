const int row = r;
for (int n = 0; n < $length; n += $width) {
    const int at = min(n, $last);
    vec${suffix} a[$width];
    for (int lane = 0; lane < $width; ++lane) {
        const int start = lane * $length + at, whole = $cols - start >= $width;
        scalar part[$width];
        if (whole) {
#pragma clang loop vectorize(assume_safety) unroll(disable)
            for (int k = 0; k < $width; ++k) {
                const int i = row * $cols + start + k;
                real now;
                $value
                part[k] = now;
            }
        } else {
#pragma clang loop vectorize(disable) unroll(disable)
            for (int k = 0; k < $width; ++k) {
                const int i = row * $cols + min(start + k, $cols - 1);
                real now;
                $value
                part[k] = start + k < $cols ? now : 0;
            }
        }
        a[lane] = *(const vec${suffix} *)part;
    }
    keep_lanes${suffix}($to + ROW${suffix}(row), a, at, 1);
}
sides${suffix}($to, ROW${suffix}(row));

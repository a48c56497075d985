        // $method: $count steps of $step, each one sweep
        real *from = y, *to = $other;
        for (int n = 0; n < $count; ++n) {
$step_text
            real *const swap = from; from = to; to = swap;
        }

        // $method: $count steps of $step
        for (int n = 0; n < $count; ++n) {
            const real h = $h;
$step_text
        }

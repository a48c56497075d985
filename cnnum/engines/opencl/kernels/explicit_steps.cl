        // $count steps of $step
        for (int n = 0; n < $count; ++n) {
$step_text
        }

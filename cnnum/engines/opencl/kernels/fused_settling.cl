        // $method: at most $count steps of $step, a lane stops where nothing changes any more
        real running = ONE, time = ZERO, steps = ZERO, settled = ZERO;
        real *from = y, *to = $other;
        for (int n = 0; n < $count && ANY_LANE(running); ++n) {
            real change = -HUGE;  // above the tolerance
$step_text
            real *const swap = from; from = to; to = swap;
            time += running * $h;
            steps += running;
            settled = PICK(change <= ZERO, ONE, settled);
            running = PICK(change <= ZERO, ZERO, running);
        }

        // $method: steps follow the error estimate
        real time = ZERO, steps = ZERO, settled = ZERO, error = ZERO, h = $first_step;
        real speed_before = ZERO, behind = ZERO;
        real running = PICK(time < $duration, ONE, ZERO);
$first_rates
        for (int i = 0; i < $states; ++i) {
            speed_before = greater(speed_before, fabs(k0[i]));
        }
        for (int n = 0; n < $limit && ANY_LANE(running); ++n) {
            real worst = ZERO, added = ZERO, speed = ZERO, change = ZERO;
            h = fmin(fmin(h, $longest), $duration - time);
$stages
$judge
            const real accept = PICK(worst <= ONE, running, ZERO);
$advance
            // what rounding leaves out of the time comes with the next step
            const real ahead = accept * h - behind, reached = time + ahead;
            behind = (reached - time) - ahead;
            time = reached;
            steps += running;
            // an error grows as the rates do, within what the feedback allows
            const real faster = fmax(speed / fmax(speed_before, $smallest_rate), ONE);
            const real grown = fmin(faster, exp(fmin($growth * h, $largest_exponent)));
            error = PICK(accept != ZERO, fmin(error * grown + added, $lost), error);
            speed_before = PICK(accept != ZERO, speed, speed_before);
            settled = PICK(accept * $settle != ZERO && change <= ONE, ONE, settled);
            running = PICK(time >= $duration * $almost_one || settled != ZERO, ZERO, running);
            h = PICK(running != ZERO,
                     h * clamp(R(0.9) * pow(fmax(worst, R(1e-10)), $exponent), R(0.2), R(5)), h);
        }
        unfinished = fmax(unfinished, running);

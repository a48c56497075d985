"""Design of templates: from rules and examples to weights, with a proof of what they do."""

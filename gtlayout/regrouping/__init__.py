"""After stage 4: instances that are one plane are joined, those that are two are split."""

"""What is wrong with a link: causes ranked by what its stations say of each other."""

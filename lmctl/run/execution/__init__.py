"""One job being run on one accepted cell: how far it is, its segments between holds, its layers."""

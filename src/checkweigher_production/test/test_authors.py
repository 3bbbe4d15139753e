# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Who makes a change: persons while they call a service, else the node."""

from checkweigher_production.authors import Author, Authors


def test_who_calls_a_service_is_its_author_until_the_call_has_ended():
    authors, ann = Authors(patience=10.0), Author('ann', 'order 7')
    assert authors.of('select_product', '/product', 0.0) == Author('graph:/product')

    authors.announce(ann, ['select_product'], 1.0)
    assert authors.of('select_product', '/product', 2.0) == ann
    assert authors.of('new_batch', '/product', 2.0) == Author('graph:/product')

    authors.announce(ann, [], 3.0)
    assert authors.of('select_product', '/product', 3.0) == Author('graph:/product')


def test_two_persons_at_once_keep_their_own_services_until_they_are_forgotten():
    authors = Authors(patience=10.0)
    authors.announce(Author('ann'), ['zero'], 1.0)
    authors.announce(Author('bob'), ['new_batch'], 1.5)
    assert authors.of('zero', '/segmenter', 2.0).who == 'ann'
    assert authors.of('zero', '/segmenter', 11.5) == Author('graph:/segmenter')
    assert authors.of('new_batch', '/product', 2.0).who == 'bob'
